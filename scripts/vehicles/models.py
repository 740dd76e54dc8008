"""The models by name; the dimensions are typical of their class, those of nobody's vehicle in particular."""

from __future__ import annotations

from collections.abc import Callable

from .car import car
from .car_lines import Car
from .car_outlines import Face
from .domes import End
from .flank import flank
from .roadside import column, guard_rail, lamp_post, noise_wall
from .tessellate import Patch
from .tree import Tree, tree
from .truck import Truck, truck
from .wheels import Wheel

SALOON = Car(
    length=4650.0, width=1820.0, height=1435.0, wheelbase=2760.0, front_overhang=870.0, clearance=170.0,
    wheel=Wheel(328.0, 226.0, 215.0), nose_height=742.0, cowl=(1300.0, 958.0), screen_rake=28.5, deck=(4070.0, 1035.0),
    back_rake=26.0, tumblehome=20.0, shelf=88.0, roof_peak=2600.0, roof_fall=44.0, shoulder=52.0, gutter=105.0, crease=0.80,
    nose=((100, 170, 230, 300, 390, 500, 560, 640, 700, 760, 850, 1250), (150, 78, 36, 18, 9, 8, 12, 24, 42, 74, 140, 500)),
    tail=((100, 170, 260, 400, 520, 580, 640, 800, 950, 1250), (150, 90, 30, 3, 0, 8, 22, 30, 34, 80)),
    side=((100, 170, 260, 400, 560, 650, 760, 850, 950, 1250), (110, 72, 32, 9, 0, 1, 5, 15, 36, 150)),
    front=End(780.0, 2.9, 22.0), rear=End(640.0, 3.2, 25.0), screen=End(500.0, 3.3, 20.0), back=End(500.0, 3.2, 20.0),
    glass=(1376.0, 1352.0, 1368.0), flare=14.0, bulge=10.0)
SALOON_FACE = Face(
    lamp=((0.49, 618.0), (0.79, 624.0), (0.955, 684.0), (0.965, 734.0), (0.80, 720.0), (0.51, 696.0)),
    daylight=((0.515, 632.0), (0.785, 638.0), (0.93, 690.0)), lenses=((0.60, 670.0, 33.0), (0.71, 677.0, 33.0)),
    grille=((0.0, 545.0), (0.33, 545.0), (0.44, 615.0), (0.42, 682.0), (0.0, 690.0)), slats=24.0,
    intake=((0.0, 245.0), (0.55, 245.0), (0.49, 335.0), (0.0, 340.0)),
    fog=((0.66, 255.0), (0.86, 275.0), (0.88, 380.0), (0.70, 340.0)), plate=440.0,
    tail_lamp=((0.60, 745.0), (0.94, 725.0), (0.945, 872.0), (0.60, 890.0)), rear_plate=800.0, fold=226.0, sill=205.0)

SUV = Car(
    length=4560.0, width=1880.0, height=1670.0, wheelbase=2680.0, front_overhang=900.0, clearance=215.0,
    wheel=Wheel(356.0, 240.0, 225.0), nose_height=905.0, cowl=(1280.0, 1095.0), screen_rake=34.0, deck=(4470.0, 1130.0),
    back_rake=62.0, tumblehome=17.0, shelf=85.0, roof_peak=2500.0, roof_fall=22.0, shoulder=55.0, gutter=100.0, crease=0.80,
    nose=((100, 215, 290, 380, 480, 600, 720, 820, 880, 940, 1050, 1450), (190, 85, 35, 14, 8, 10, 20, 34, 52, 95, 170, 500)),
    tail=((100, 215, 300, 450, 600, 680, 800, 950, 1100, 1450), (190, 100, 35, 3, 0, 10, 22, 28, 40, 110)),
    side=((100, 215, 300, 460, 640, 760, 880, 970, 1080, 1450), (100, 55, 28, 8, 0, 1, 6, 15, 38, 150)),
    front=End(720.0, 3.0, 22.0), rear=End(560.0, 3.4, 25.0), screen=End(480.0, 3.4, 20.0), back=End(460.0, 3.6, 25.0),
    glass=(1600.0, 1585.0, 1570.0), flare=20.0, bulge=14.0)
SUV_FACE = Face(
    lamp=((0.50, 765.0), (0.80, 768.0), (0.955, 800.0), (0.965, 868.0), (0.80, 872.0), (0.52, 858.0)),
    daylight=((0.525, 848.0), (0.80, 861.0), (0.93, 858.0)), lenses=((0.605, 808.0, 32.0), (0.74, 812.0, 32.0)),
    grille=((0.0, 680.0), (0.36, 680.0), (0.44, 760.0), (0.43, 850.0), (0.0, 858.0)), slats=40.0,
    intake=((0.0, 335.0), (0.56, 335.0), (0.48, 460.0), (0.0, 465.0)),
    fog=((0.66, 400.0), (0.86, 420.0), (0.88, 540.0), (0.68, 520.0)), plate=572.0,
    tail_lamp=((0.66, 800.0), (0.935, 800.0), (0.94, 985.0), (0.64, 1010.0)), rear_plate=820.0, fold=345.0, sill=310.0)

VAN = Car(
    length=5300.0, width=1990.0, height=2230.0, wheelbase=3280.0, front_overhang=960.0, clearance=200.0,
    wheel=Wheel(345.0, 215.0, 215.0, steel=True), nose_height=960.0, cowl=(790.0, 1165.0), screen_rake=51.0,
    deck=(5262.0, 1180.0), back_rake=87.5, tumblehome=4.5, shelf=66.0, roof_peak=3000.0, roof_fall=6.0, shoulder=60.0,
    gutter=85.0, crease=0.76,
    nose=((100, 200, 280, 380, 480, 600, 720, 850, 930, 1000, 1200, 1500), (170, 80, 32, 12, 8, 14, 32, 62, 95, 150, 330, 560)),
    tail=((100, 200, 300, 420, 520, 600, 800, 1150, 1500), (90, 50, 20, 2, 0, 20, 25, 30, 40)),
    side=((100, 200, 300, 450, 620, 800, 950, 1080, 1180, 1500), (90, 48, 22, 5, 0, 0, 3, 10, 18, 40)),
    front=End(680.0, 3.0, 30.0), rear=End(260.0, 4.2, 15.0), screen=End(340.0, 3.8, 60.0), back=End(240.0, 4.4, 15.0),
    glass=(1915.0, 1870.0, 1800.0), flare=12.0, bulge=12.0)
VAN_FACE = Face(
    lamp=((0.56, 700.0), (0.82, 705.0), (0.945, 760.0), (0.955, 930.0), (0.86, 925.0), (0.58, 800.0)),
    daylight=((0.60, 718.0), (0.81, 722.0), (0.925, 775.0)), lenses=((0.69, 765.0, 36.0), (0.83, 812.0, 36.0)),
    grille=((0.0, 690.0), (0.46, 690.0), (0.48, 800.0), (0.0, 815.0)), slats=36.0,
    intake=((0.0, 290.0), (0.56, 290.0), (0.52, 400.0), (0.0, 405.0)),
    fog=((0.66, 330.0), (0.84, 345.0), (0.84, 440.0), (0.67, 430.0)), plate=530.0,
    tail_lamp=((0.84, 700.0), (0.95, 700.0), (0.95, 1060.0), (0.84, 1060.0)), rear_plate=760.0, fold=610.0, sill=300.0)

TRUCK = Truck(
    length=8600.0, width=2500.0, height=3700.0, cab_length=1980.0, cab_width=2350.0, cab_height=2860.0, cab_floor=430.0,
    box_front=2130.0, box_floor=1120.0, axles=(1310.0, 6050.0), wheel=Wheel(480.0, 270.0, 285.0, steel=True))

TREE_1 = Tree(height=9500.0, clear=2300.0, radius=3700.0, lobes=18, cards=4900, seed=3)
TREE_2 = Tree(height=12_500.0, clear=2800.0, radius=3900.0, lobes=21, cards=5000, seed=11)

MODELS: dict[str, Callable[[], list[Patch]]] = {
    "saloon": lambda: car(SALOON, SALOON_FACE, (2440.0, 3390.0, 3730.0)),
    "suv": lambda: car(SUV, SUV_FACE, (2370.0, 3330.0, 4120.0), cladding=True),
    "van": lambda: car(VAN, VAN_FACE, (2120.0,), doors=1),
    "truck": lambda: truck(TRUCK),
    "light-truck-flank": flank,
    "column": column,
    "lamp-post": lamp_post,
    "guard-rail": guard_rail,
    "noise-wall": noise_wall,
    "tree-1": lambda: tree(TREE_1),
    "tree-2": lambda: tree(TREE_2),
}
