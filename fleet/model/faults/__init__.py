"""Communication faults as data: rules, and what they do to one message on one directed link.

Faults act at the receiver, since one publication has many receivers. Every random draw is a keyed
hash of (seed, what for, source, receiver, class, sequence number), never taken from a generator
when a message arrives: outcomes do not depend on scheduling, and the same draw serves every level
of a fault, so that what is lost at 10 percent is lost at 20 percent too.
"""
