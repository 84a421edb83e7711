"""Gait: contact, events, cycles."""
