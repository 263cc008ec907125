"""The day in the field as plain functions: plan it, set up a campaign, record, follow and steer what runs.

They raise, return results and report progress through callbacks; they never print or ask.
"""
