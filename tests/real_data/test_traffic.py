"""The traffic experiment on the logs of the data folder, as its presets read them."""

import pytest

from tests.experiments.drives import FEW, SMALL, run

pytestmark = pytest.mark.real_data
TEAMS = ("HAM", "VER", "GAS")


@pytest.fixture(scope="module")
def home(data_dir, tmp_path_factory):
    for name in ("f1_sakhir", "openacc"):
        if not (data_dir / "traffic" / name).is_dir():
            pytest.skip(f"no logs at {data_dir / 'traffic' / name}")
    root = tmp_path_factory.mktemp("traffic")
    (root / "data").symlink_to(data_dir.absolute(), target_is_directory=True)
    return root


@pytest.fixture(scope="module")
def sakhir(home):
    names = ",".join(f"data/traffic/f1_sakhir/{team}/*_tel.json" for team in (*TEAMS, "BOT"))
    line = "course.line=data/traffic/f1_sakhir/reference_line/tracks/Sakhir.csv"
    areas = "course.areas=[start:0:1500,rest:1500:0]"
    small = (*SMALL, areas, "teams.deals=6", "teams.divergence.ks=[1]")
    done = run(home, "preset=f1_sakhir", f"files=[{names}]", line, *small)
    assert done.code == 0, done.err
    return done


@pytest.fixture(scope="module")
def platoons(home):
    names = ",".join(f"data/traffic/openacc/{name}.csv" for name in ("short_setting/handling_part14", "no_ACC/*"))
    done = run(home, "preset=openacc", f"files=[{names}]", *FEW)
    assert done.code == 0, done.err
    return done


def test_the_frozen_driver_is_left_out_with_a_verdict(sakhir):
    verdicts = {row["log"]: row["verdict"] for row in sakhir.table("logs")}
    assert len(verdicts) == 12
    assert all(verdict.startswith("frozen: ") == name.startswith("BOT") for name, verdict in verdicts.items())
    assert [row["team"] for row in sakhir.table("teams")] == list(TEAMS)
    assert (sakhir.summary["logs"], sakhir.summary["logs_left_out"]) == (12, 3)
    assert sakhir.out.count("Left out: BOT") == 3


def test_all_laps_lie_on_the_reference_line(sakhir):
    assert sakhir.summary["alignment_rms_m"] < 3.5
    for row in sakhir.table("teams"):
        assert row["runs"] == "3"
        assert 94.0 < float(row["time of a run [s]"]) < 98.5
        assert abs(float(row["offset [m]"])) < 1.5
    assert sakhir.summary["course_m"] == pytest.approx(5406, abs=15)


def test_equal_drivers_are_told_apart_by_no_excess_and_a_coarse_one_is(sakhir):
    numbers = sakhir.summary
    for p in TEAMS:
        for q in TEAMS:
            if p == q:
                continue
            whole, given = (numbers[f"{kind}_{p}_{q}_nats"] for kind in ("excess", "excess_given_station"))
            if "GAS" in (p, q):
                assert whole > 0.5
                assert given > 1.5
                assert numbers[f"mean_distance_{p}_{q}_m"] > 3.5
            else:
                assert abs(whole) < 0.3
                assert abs(given) < 0.3
                assert numbers[f"divergence_{p}_{q}_nats"] < -0.5  # regular spacing along a curve
                assert numbers[f"mean_distance_{p}_{q}_m"] < 2.5


@pytest.mark.slow  # experiments/test_traffic.py has a made-up platoon, test_flow.py these logs
def test_deviations_and_gains_of_platoons_are_those_of_their_speeds(platoons):
    rows = {row["platoon"]: row for row in platoons.table("platoons")}
    expected = {
        "short_setting handling_part14": (10, 5.20, 7.15, 1.378, 5.20),
        "no_ACC handling_part40": (7, 5.56, 5.78, 1.044, 1.10),
    }
    assert rows.keys() == expected.keys()
    for name, (vehicles, head, tail, whole, moving) in expected.items():
        row, flat = rows[name], name.replace(" ", "_")
        assert int(row["vehicles"]) == vehicles
        assert float(row["speed deviation, head [m/s]"]) == pytest.approx(head, abs=0.006)
        assert float(row["tail [m/s]"]) == pytest.approx(tail, abs=0.006)
        assert platoons.summary[f"{flat}_gain_whole"] == pytest.approx(whole, abs=5e-3)
        assert platoons.summary[f"{flat}_gain_moving"] == pytest.approx(moving, abs=0.02)
    assert rows["short_setting handling_part14"]["TET [s]"] == "0.0"
