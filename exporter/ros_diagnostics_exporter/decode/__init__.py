"""Bytes to statuses: CDR, and the messages that wait for decoding, in bounded queues."""
