"""The demo: the whole road from a virtual robot to an email, on one machine, from real parts."""
