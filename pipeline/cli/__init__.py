"""The command line, ``hbm``."""


def main() -> int:
    """Run the command line; processes that a command starts import this module and no more."""
    from pipeline.cli.app import main as run

    return run()
