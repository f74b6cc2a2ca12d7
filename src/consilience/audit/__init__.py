"""Audits: the harness, its adapters and its reference judged by planted errors, random mechanisms and identities."""
