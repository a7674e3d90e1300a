"""Small maps with known answers, as the text of their files."""

import numpy as np

ARC = np.linspace(0, np.pi / 2, 13)
LEFT_ARC = np.stack([40 + 18.25 * np.sin(ARC), 25.25 - 18.25 * np.cos(ARC)], -1)
RIGHT_ARC = np.stack([40 + 21.75 * np.sin(ARC), 25.25 - 21.75 * np.cos(ARC)], -1)


def _points(points, tag="point"):
    return "".join(f"<{tag}>\n<x>{x:.4f}</x>\n<y>{y:.4f}</y>\n</{tag}>\n" for x, y in points)


def _lanelet(number, left, right, rest, marks=("dashed", "solid")):
    marks = [f"<lineMarking>{mark}</lineMarking>\n" if mark else "" for mark in marks]
    return (
        f'<lanelet id="{number}">\n<leftBound>\n{_points(left)}{marks[0]}</leftBound>\n'
        f"<rightBound>\n{_points(right)}{marks[1]}</rightBound>\n{rest}\n</lanelet>\n"
    )


def _state(tag, step, x, y, speed=10.0):
    velocity = "" if speed is None else f"<velocity><exact>{speed}</exact></velocity>\n"
    return (
        f"<{tag}>\n<position>\n{_points([(x, y)])}</position>\n<orientation><exact>0.1</exact></orientation>\n"
        f"<time><exact>{step}</exact></time>\n{velocity}</{tag}>\n"
    )


def _row(y, start=0.0, end=40.0):
    return [(start, y), (0.5 * (start + end), y), (end, y)]


def _sign(number, kind, value=""):
    value = value and f"<additionalValue>{value}</additionalValue>"
    return (
        f'<trafficSign id="{number}">\n<trafficSignElement>\n<trafficSignID>{kind}</trafficSignID>\n{value}\n'
        "</trafficSignElement>\n</trafficSign>\n"
    )


LANELETS = [  # two lanes eastwards and one westwards; the right one goes on, the left one turns left
    _lanelet(
        1,
        _row(3.5),
        _row(0),
        '<successor ref="3"/>\n<adjacentLeft ref="2" drivingDir="same"/>\n<stopLine>\n'
        + _points([(38, 0), (38, 3.5)])
        + '<trafficLightRef ref="20"/>\n</stopLine>\n<laneletType>urban</laneletType>\n<trafficSignRef ref="10"/>',
        marks=("solid", "solid"),
    ),
    _lanelet(
        2,
        _row(7),
        _row(3.5),
        '<successor ref="4"/>\n<adjacentLeft ref="5" drivingDir="opposite"/>\n'
        '<adjacentRight ref="1" drivingDir="same"/>\n<trafficSignRef ref="11"/>',
        marks=("dashed", "dashed"),
    ),
    _lanelet(3, _row(3.5, 40, 60), _row(0, 40, 60), '<predecessor ref="1"/>'),
    _lanelet(4, LEFT_ARC, RIGHT_ARC, '<predecessor ref="2"/>'),
    _lanelet(
        5,
        _row(7, 40, 0),
        _row(10.5, 40, 0),
        '<adjacentLeft ref="2" drivingDir="opposite"/>\n<trafficSignRef ref="12"/>',
    ),
    _lanelet(6, _row(-3, 40, 0), _row(0, 40, 0), "<laneletType>sidewalk</laneletType>"),
]
SHAPE = "<shape>\n<rectangle><length>4.5</length><width>1.8</width></rectangle>\n</shape>\n"
PROBLEM = (
    '<planningProblem id="200">\n'
    + _state("initialState", 0, 2, 1.75, 8.0)
    + '<goalState>\n<position>\n<lanelet ref="4"/>\n</position>\n'
    "<time><intervalStart>10</intervalStart><intervalEnd>20</intervalEnd></time>\n"
    "<velocity><intervalStart>3</intervalStart><intervalEnd>9</intervalEnd></velocity>\n</goalState>\n"
    "<goalState>\n<position>\n<rectangle><length>6</length><width>2</width><orientation>0.5</orientation>"
    "<center><x>50</x><y>1.75</y></center></rectangle>\n</position>\n<time><exact>30</exact></time>\n</goalState>\n"
    "</planningProblem>\n"
)
MOVING = (
    _state("initialState", 0, 5, 1.75) + "<trajectory>\n" + _state("state", 1, 6, 1.75) + _state("state", 2, 7, 1.75)
)
COMMONROAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<commonRoad commonRoadVersion="2020a" timeStepSize="0.1">\n'
    "<scenarioTags>\n<urban/>\n</scenarioTags>\n"
    + "".join(LANELETS)
    + _sign(10, "274", 10.0)
    + _sign(11, "R2-1", "25mph")
    + _sign(12, "206")
    + '<trafficLight id="20">\n<cycle>\n'
    + "".join(
        f"<cycleElement>\n<duration>{steps}</duration>\n<color>{colour}</color>\n</cycleElement>\n"
        for steps, colour in ((200, "red"), (100, "green"), (30, "yellow"))
    )
    + "<timeOffset>50</timeOffset>\n</cycle>\n<active>true</active>\n</trafficLight>\n"
    '<intersection id="30">\n<incoming id="31">\n<incomingLanelet ref="2"/>\n<successorsLeft ref="4"/>\n</incoming>\n'
    "</intersection>\n"
    f'<dynamicObstacle id="100">\n<type>car</type>\n{SHAPE}{MOVING}</trajectory>\n</dynamicObstacle>\n'
    '<staticObstacle id="101">\n<type>parkedVehicle</type>\n'
    f"{SHAPE}{_state('initialState', 0, 30, 5.25, None)}</staticObstacle>\n{PROBLEM}</commonRoad>\n"
)
OLDER = (
    '<commonRoad commonRoadVersion="2018b" timeStepSize="0.2" tags="highway multi_lane">\n'
    + _lanelet(7, _row(3.5), _row(0), "<speedLimit>25.5</speedLimit>")
    + f'<obstacle id="8">\n<role>dynamic</role>\n<type>truck</type>\n{SHAPE}{MOVING}</trajectory>\n</obstacle>\n'
    f'<obstacle id="9">\n<role>static</role>\n<type>unknown</type>\n{SHAPE}'
    f"{_state('initialState', 0, 9, 1)}</obstacle>\n"
    "</commonRoad>\n"
)

NODES = {  # borders of two lanes eastwards, of one that goes on, of one both ways to the south and a crosswalk
    **{1: (0, 0), 2: (40, 0), 3: (0, 3.5), 4: (40, 3.5), 5: (0, 7), 6: (40, 7), 7: (70, 0), 8: (70, 3.5)},
    **{9: (0, -20), 10: (40, -20), 11: (0, -26), 12: (40, -26), 13: (39, 0), 14: (39, 3.5), 15: (50, -5), 16: (50, -9)},
}
WAYS = {  # nodes, and tags; the second lies against the driving direction
    21: ((1, 2), {"type": "road_border"}),
    22: ((4, 3), {"type": "line_thin", "subtype": "solid_dashed"}),
    23: ((5, 6), {"type": "line_thin", "subtype": "solid"}),
    24: ((2, 7), {"type": "road_border"}),
    25: ((4, 8), {"type": "line_thin", "subtype": "dashed"}),
    26: ((9, 10), {"type": "road_border"}),
    27: ((11, 12), {"type": "road_border"}),
    28: ((13, 14), {"type": "stop_line"}),
    29: ((15, 16), {"type": "traffic_light"}),
    30: ((15, 16), {"type": "traffic_sign", "subtype": "stop_sign"}),
}
RELATIONS = {  # members, and tags
    41: ([("way", "left", 22), ("way", "right", 21), ("relation", "regulatory_element", 51)], {"speed_limit": "36"}),
    42: ([("way", "left", 23), ("way", "right", 22)], {"speed_limit": "20 mph"}),
    43: ([("way", "left", 25), ("way", "right", 24)], {"turn_direction": "straight"}),
    44: ([("way", "left", 26), ("way", "right", 27), ("relation", "regulatory_element", 52)], {"one_way": "no"}),
    45: ([("way", "left", 26), ("way", "right", 27)], {"subtype": "crosswalk"}),
}


def lanelet2(local=True):
    """A Lanelet2 file, in metres or in degrees around 48 north, 11 east."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<osm>"]
    for key, (x, y) in NODES.items():
        tags = f'<tag k="local_x" v="{x + 80000}"/>\n<tag k="local_y" v="{y}"/>\n' if local else ""
        lines.append(f'<node id="{key}" lat="{48 + y / 111198.0:.9f}" lon="{11 + x / 74633.0:.9f}">\n{tags}</node>')
    for key, (nodes, tags) in WAYS.items():
        refs = "\n".join(f'<nd ref="{node}"/>' for node in nodes)
        lines.append(f'<way id="{key}">\n{refs}\n{_tags(tags)}\n</way>')
    regulatory = {
        51: ([("way", "refers", 29), ("way", "ref_line", 28)], {"subtype": "traffic_light"}),
        52: ([("way", "refers", 30)], {"subtype": "traffic_sign"}),
    }
    for kind, table in (("lanelet", RELATIONS), ("regulatory_element", regulatory)):
        for key, (members, tags) in table.items():
            refs = "\n".join(f'<member type="{t}" role="{role}" ref="{ref}"/>' for t, role, ref in members)
            default = {"type": kind, "subtype": "road", "location": "urban"}
            lines.append(f'<relation id="{key}">\n{refs}\n{_tags(default | tags)}\n</relation>')
    return "\n".join([*lines, "</osm>\n"])


def _tags(tags):
    return "\n".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())


SUMO = """<?xml version="1.0" encoding="UTF-8"?>
<net version="1.20">
<location netOffset="0,0" convBoundary="0,0,100,60"/>
<edge id=":j_0" function="internal">
<lane id=":j_0_0" index="0" speed="10" length="20" shape="40.0,-1.6 60.0,-1.6"/>
</edge>
<edge id=":j_1" function="internal">
<lane id=":j_1_0" index="0" speed="6" length="20" shape="40.0,1.6 48.0,3.0 50.0,14.0"/>
</edge>
<edge id=":j_2" function="internal">
<lane id=":j_2_0" index="0" speed="6" length="0.05" shape="50.0,14.0 50.0,14.05"/>
</edge>
<edge id=":k_0" function="internal">
<lane id=":k_0_0" index="0" speed="6" length="8" shape="0.0,1.6 -2.0,0.0 0.0,-1.6"/>
</edge>
<edge id="in" from="a" to="j" type="highway.primary">
<lane id="in_0" index="0" disallow="tram rail" speed="13.9" length="40" shape="0.0,-1.6 40.0,-1.6"/>
<lane id="in_1" index="1" speed="13.9" length="40" shape="0.0,1.6 40.0,1.6" width="3.0" changeRight="bus"/>
<lane id="in_2" index="2" allow="bicycle" speed="13.9" length="40" shape="0.0,4.8 40.0,4.8"/>
</edge>
<edge id="on" from="j" to="b">
<lane id="on_0" index="0" speed="13.9" length="40" shape="60.0,-1.6 100.0,-1.6"/>
</edge>
<edge id="up" from="j" to="c">
<lane id="up_0" index="0" speed="8.3" length="40" shape="50.0,14.0 50.0,54.0"/>
</edge>
<tlLogic id="j" type="static" programID="0" offset="5">
<phase duration="30" state="Gr"/>
<phase duration="4" state="yr"/>
<phase duration="26" state="rG"/>
</tlLogic>
<junction id="j" type="traffic_light"/>
<junction id="a" type="priority"/>
<connection from="in" to="on" fromLane="0" toLane="0" via=":j_0_0" tl="j" linkIndex="0" dir="s" state="O"/>
<connection from="in" to="up" fromLane="1" toLane="0" via=":j_1_0" tl="j" linkIndex="1" dir="l" state="o"/>
<connection from="in" to="on" fromLane="1" toLane="0" tl="j" linkIndex="0" dir="s" state="O"/>
<connection from=":j_0" to="on" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":j_1" to="up" fromLane="0" toLane="0" via=":j_2_0" dir="l" state="m"/>
<connection from=":j_2" to="up" fromLane="0" toLane="0" dir="l" state="M"/>
<connection from="up" to="gone" fromLane="0" toLane="0" dir="s" state="M"/>
</net>
"""
