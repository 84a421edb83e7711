"""Attacks on the program: damaged files, killed runs, odd environments, texts that want to get out.

``python -m tests.campaign`` makes them all, ``--short`` a choice within two minutes.
"""
