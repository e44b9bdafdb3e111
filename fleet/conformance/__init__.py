"""The conformance test: plays a run to one foreign UAV, and names the rules that it breaks.

A play (`lockstep_play`, `realtime_play`) says what its script says and keeps all that it hears as
`Evidence`; the rules (`rules/`), one small function each, judge from that alone. What is played,
and what the answer has to be, is data in the scripts.
"""
