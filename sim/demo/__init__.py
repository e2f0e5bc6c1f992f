"""The whole road on one machine: virtual robots to email. What `./run demo` and the tests share.

It starts the other programs and reads what they serve; it imports none of them.
"""
