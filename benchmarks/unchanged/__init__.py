"""Proofs that a refactoring changed nothing: the same work by two checkouts, and what differs."""
