"""The commands of BlueSky that are not taken over, and why."""

from __future__ import annotations


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


OTHER_NAMES = {
    "CREATE": "CRE",
    "HEADING": "HDG",
    "TURN": "HDG",
    "SPEED": "SPD",
    "BANKLIM": "BANK",
    "PZR": "ZONER",
    "RPZ": "ZONER",
    "PZRADIUS": "ZONER",
    "PZDH": "ZONEDH",
    "DHPZ": "ZONEDH",
    "PZHEIGHT": "ZONEDH",
}
"""Synonyms of commands, and what they are called here."""

SHOWING = _words(
    "PAN ZOOM + - ++ -- SYMBOL SWRAD DISP LABEL TRAIL TRAILS COLOR COLOUR COL ECHO PRINT SSD "
    "POLY POLYGON POLYALT POLYLINE POLYLINES LINE LINES BOX CIRCLE NAVDISP SHOWTRAF SHOWPOLY "
    "PLOT FF FWD OP START RUN CONTINUE HOLD PAUSE DT DTMULT RTF RT REALTIME FIXDT SCEN "
    "SCENARIO DATE TIME SAVEIC POS DIST INFO HELP INSEDIT FILTERALT SCREENSHOT ORIG SEED QUIT "
    "STOP RESET IC BENCHMARK"
)
"""Commands that show, pace, record or name, and change no flight."""

AVOIDANCE = _words(
    "ASAS CDMETHOD RESO RESOMETHOD RMETHH RMETHV RFACH RFACV RESOFACH RESOFACV PRIORULES "
    "NORESO RESOOFF DTNOLOOK RSZONER RSZONEDH"
)
"""Settings of BlueSky's own avoidance."""

WAYPOINT_MODES = _words(
    "FLYBY FLYOVER FLYTURN TURNSPD TURNSPEED TURNRAD TURNRADIUS TURNHDG TURNHDGR TURNHDGRATE "
    "TURNBANK TURNPHI TAKEOFF"
)
"""What ADDWPT may have in place of a position."""

WHY_NOT = {
    "WIND": "there is no wind here: aircraft fly over ground as they do through the air",
    "NOISE": "noise is not taken over; see the faults 'navigation' and 'loss'",
    "AREA": "no area deletes a UAV that leaves it",
    "DEL": "a UAV stays to the end of the run",
    "DELETE": "a UAV stays to the end of the run",
    "MCRE": "random aircraft are not taken over",
    "SYN": "a program that makes aircraft; save what it makes (SAVEIC), and import that",
    "TRAFGEN": "a program that makes aircraft; save what it makes (SAVEIC), and import that",
    "PCALL": "another file; import that one by itself",
    "CALL": "another file; import that one by itself",
    "ATALT": "a condition; nothing here waits for one",
    "ATSPD": "a condition; nothing here waits for one",
    "ATDIST": "a condition; nothing here waits for one",
    "SCHEDULE": "a command inside another; write it with its own time",
    "DELAY": "a command inside another; write it with its own time",
}
