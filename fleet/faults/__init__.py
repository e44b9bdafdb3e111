"""Faults as data: rules, one module a kind, and what they do to messages and participants.

`plan` has all rules together, `channel` their effect on one message on one directed link. Faults of
links act at the receiver, since one publication has many receivers. Every random draw is a keyed
hash of the seed, the rule's place in the plan and what it is for (a message on a link; a moment of
a UAV), never taken from a generator: outcomes do not depend on scheduling, and the same draw serves
every level of a fault, so that what is lost at 10 percent is lost at 20 percent too.
"""
