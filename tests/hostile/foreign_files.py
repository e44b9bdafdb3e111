"""Files of other programs, and a hosts file with every key: seeds."""

from __future__ import annotations

HOSTS = """
scenario = "four_way"
set = ["duration_s=60", "uav.2.speed_mps=20"]
clock = "realtime"
port = 7448
wait_s = 60
command = "/opt/fleet/bin/fleet"
secure = "/etc/fleet"
image = "fleet"

[[host]]
name = "alpha"
roles = ["router", "simulation"]

[[host]]
name = "beta"
roles = ["coordinator"]
uavs = "1-2,4"

[[host]]
name = "10.0.0.3"
uavs = "rest"
"""

BLUESKY = (
    """# a comment
00:00:00.00>CRE AC1 A320 0 0 90 FL50 250
00:00:00.00>DEFWPT GOAL,0,1.0
00:00:00.00>DEST AC1 5,5
00:00:00.00>AC1 DEST GOAL
00:00:00.00>ADDWPT AC1 0.1 , 0.2
00:00:00.00>AC1 ADDWPT N0'12', E0'24' FL60
00:00:00.00>ADDWPT AC1 FLYOVER
00:00:00.00>CRECONFS AC2,A320,AC1,90,1.0,120
""",
    """00:00:00.00>ZONER 3
00:00:00.00>ZONEDH 500
00:00:00.00>DTLOOK 120
00:00:10.00>CRE AC1,A320,0,0,90,0,200
00:00:00.00>BANK AC1,35
00:00:40.00>CRE AC2,A320, \\
  0,1,270,0,200
00:00:00.00>VS AC1,-600
00:00:00.00>ALT AC1,FL200
00:00:05.00>SPD AC2,250
00:00:06.00>HDG AC2,95
""",
)
DAIDALUS = (
    """# made
NAME lat lon alt trk gs vs time
[none] [deg] [deg] [ft] [deg] [knot] [fpm] [s]
Ownship, 47.0, 8.0, 400.0, 90.0, 40.0, 0.0, 0.0
Intruder, 47.0, 8.03, 300.0, 270.0, 30.0, 100.0, 0.0
Ownship, 47.0, 8.001, 400.0, 90.0, 40.0, 0.0, 4.0
Intruder, 47.0, 8.0295, 306.0, 270.0, 30.0, 100.0, 4.0
""",
    """NAME sx sy sz vx vy vz time
[none] [NM] [NM] [ft] [knot] [knot] [fpm] [s]
A, 0.0, 0.0, 1000, 100, 0, 0, 0
B, 5.0, 0.0, 1000, -100, 0, 0, 0
A, 0.03, 0.0, 1000, 100, 0, 0, 1
B, 4.97, 0.0, 1000, -100, 0, 0, 1
""",
)
CSV = (
    """id,time_s,lat_deg,lon_deg,alt_m
A,0,47.0,8.0,100
A,30,47.0,8.008,110
A,60,47.004,8.01,120
B,0,47.0,8.02,100
B,30,47.0,8.012,100
B,60,47.0,8.004,100
""",
    """id,time_s,lat_deg,lon_deg,alt_ft,trk_deg,gs_kt,vs_fpm
A,0,47.0,8.0,300,90,40,0
B,0,47.0,8.02,300,270,40,0
""",
)
