"""Describe plans, builds, drives and prints as text for people; the command line prints it."""
