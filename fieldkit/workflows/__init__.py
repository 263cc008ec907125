"""What people do with fieldkit, as plain functions: what a notebook calls and the command line prints.

One module per task; each needs two rooms or more (configuration, sessions, estimation, drivers, views).
They raise, return results and report progress through callbacks; they never print or ask.
"""
