"""Flashing over CAN: hostile requests, cut supplies, and what a transfer takes."""
