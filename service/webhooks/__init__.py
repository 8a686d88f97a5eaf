"""Manage webhooks and resend their messages."""
