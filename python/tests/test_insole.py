"""Sessions with a simulated insole, which runs the firmware's code for sessions."""

import asyncio
import contextlib
import os
import pathlib
import subprocess
import tomllib
from collections.abc import Iterator

import pytest
from conftest import plantar as command
from conftest import walk

import plantar

PROGRAM = os.environ.get("PLANTAR_INSOLE", "")

needs_insole = pytest.mark.skipif(not PROGRAM, reason="PLANTAR_INSOLE does not name the example simulated_insole")


@contextlib.contextmanager
def simulated(steps: int) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a simulated insole with this number of steps, and its process, which prints each acknowledgement."""
    with subprocess.Popen([PROGRAM, str(steps)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), process
        finally:
            process.kill()


@needs_insole
def test_each_step_is_acknowledged_once_the_next_event_is_requested() -> None:
    with simulated(3) as (address, process), plantar.Insole.connect(tcp=address) as insole:
        assert insole.hello["side"] in ("left", "right") and insole.hello["cells"] > 0
        assert repr(insole) == f"<Insole at {address}: right foot, 200 cells at 100 Hz, firmware 0.1.0>"
        kinds = []
        for event in insole:
            kinds.append(event.kind)
            if event.kind == "step":
                heel = event.values["regions"]["heel"]
                assert heel["measured_force_peak_n"] > 0
                if event.values["step"] == 2:
                    break
        assert kinds.count("step") == 3 and "started" in kinds
        insole.next_event()
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(3)] == [f"acknowledged {step}\n" for step in range(3)]


@needs_insole
def test_an_iteration_with_a_time_out_ends_after_the_insole_is_gone() -> None:
    with simulated(1) as (address, process), plantar.Insole.connect(tcp=address) as insole:
        kinds = []
        for event in insole.events(timeout_s=60):
            kinds.append(event.kind)
            if event.kind == "live" and process.poll() is None:
                process.kill()
                process.wait()
            if event.kind == "lost":
                break
        assert "step" in kinds and kinds[-1] == "lost"
        assert list(insole.events(timeout_s=0.5)) == []
        assert insole.next_event() is None


@needs_insole
def test_a_step_arrives_again_if_its_processing_failed() -> None:
    with simulated(2) as (address, _):
        for _ in range(2):
            with plantar.Insole.connect(tcp=address) as insole, pytest.raises(RuntimeError, match="processing"):
                for event in insole:
                    if event.kind == "step":
                        assert event.values["step"] == 0
                        raise RuntimeError("processing failed")


@needs_insole
def test_live_frames_and_steps_arrive_asynchronously() -> None:
    async def follow(address: str) -> tuple[set[str], int]:
        turns = 0

        async def count() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        kinds = set()
        counter = asyncio.create_task(count())
        with plantar.Insole.connect(tcp=address) as insole:
            async for event in insole:
                kinds.add(event.kind)
                if event.kind == "live":
                    assert event.values["regions"]["hallux"]["area_mm2"] >= 0
                if {"live", "step"} <= kinds:
                    break
        counter.cancel()
        return kinds, turns

    with simulated(1) as (address, _):
        kinds, turns = asyncio.run(follow(address))
    assert {"started", "live", "step"} <= kinds
    # Other tasks run while the iterator waits.
    assert turns > 1


@needs_insole
def test_a_cancelled_iteration_loses_no_record() -> None:
    async def follow(insole: plantar.Insole) -> set[str]:
        kinds: set[str] = set()
        frames = 0
        while frames < 300 and not {"step", "bout", "alert"} <= kinds:
            with contextlib.suppress(asyncio.TimeoutError):
                event = await asyncio.wait_for(anext(aiter(insole)), 0.001)
                kinds.add(event.kind)
                frames += event.kind == "live"
        return kinds

    with simulated(1) as (address, _), plantar.Insole.connect(tcp=address) as insole:
        assert {"step", "bout", "alert"} <= asyncio.run(follow(insole))


@needs_insole
def test_load_bouts_and_alerts_arrive_asynchronously_with_their_times_and_are_acknowledged() -> None:
    async def follow(insole: plantar.Insole) -> dict[str, plantar.Event]:
        events: dict[str, plantar.Event] = {}
        async for event in insole:
            events[event.kind] = event
            if {"live", "bout", "alert"} <= events.keys():
                break
        return events

    with simulated(1) as (address, process), plantar.Insole.connect(tcp=address) as insole:
        events = asyncio.run(follow(insole))
        insole.next_event()
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(3)] == [f"acknowledged {number}\n" for number in range(3)]
    bout, alert = events["bout"].values, events["alert"].values
    assert (bout["number"], bout["kind"], bout["duration_s"]) == (1, "shuffling", 61.23)
    assert bout["regions"]["heel"]["measured_force_integral_n_s"] == 1234.56
    assert (alert["number"], alert["window_s"], alert["dose"]) == (2, 900, ["heel"])
    assert alert["sustained"] == ["heel", "metatarsals_12", "hallux"]
    # The clock of the simulated insole began at 1.7e9 s.
    assert events["bout"].unix_s == pytest.approx(1_700_000_009.0, abs=1e-3)
    assert events["alert"].unix_s == pytest.approx(1_700_000_901.0, abs=1e-3)
    assert events["live"].unix_s == pytest.approx(1_700_005_000.01, abs=1e-3)
    assert events["started"].unix_s is None


@needs_insole
def test_pushed_parameters_are_those_that_the_command_line_reads_from_the_insole(tmp_path: pathlib.Path) -> None:
    command("params", "typical", "--size", 38, "--out", tmp_path / "params.toml")
    with simulated(0) as (address, _):
        with plantar.Insole.connect(tcp=address) as insole:
            with pytest.warns(UserWarning, match="are not personal"):
                insole.push(tmp_path / "params.toml")
        command("params", "pull", "--tcp", address, "--out", tmp_path / "pulled.toml")
    pushed, pulled = (tomllib.loads((tmp_path / name).read_text())["regions"] for name in ("params.toml", "pulled.toml"))
    for region in plantar.REGIONS:
        assert force_law(pulled[region]) == pytest.approx(force_law(pushed[region]), rel=1e-6), region


@needs_insole
def test_pushed_parameters_of_the_other_foot_and_typical_ones_are_named(tmp_path: pathlib.Path) -> None:
    params = tmp_path / "params.toml"
    # The simulated insole counts whole cells.
    counted = plantar.Options(contact_full_kpa=0)
    plantar.fit(walk(tmp_path / "walk.parquet", "--steps", 6, "--side", "left"), options=counted).write(params)
    with simulated(0) as (address, _), plantar.Insole.connect(tcp=address) as insole:
        with pytest.warns(UserWarning) as caught:
            insole.push(params)
        notes = [str(warning.message) for warning in caught]
        assert notes == ["the parameters were identified from the left foot, but this is the right foot"]
        params.write_text(params.read_text().replace('"toe_2", ', ""))
        with pytest.warns(UserWarning, match="the parameters of toe_2 are typical values"):
            insole.push(params)


def force_law(values: dict[str, float]) -> tuple[float, float, float]:
    """A B, n and K = k C^(n+1) / d0^n of a region, in SI units."""
    c_m, d0_m, n = values["c_mm"] * 1e-3, values["d0_mm"] * 1e-3, values["n"]
    return values["a_mm"] * values["b_mm"] * 1e-6, n, values["k_n_m3"] * c_m ** (n + 1) / d0_m**n


def test_errors_name_the_insole_and_the_remedy(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConnectionError, match="127.0.0.1:1: .*is the insole or its bridge running there"):
        plantar.Insole.connect(tcp="127.0.0.1:1")
    with pytest.raises(ConnectionError, match="is the insole plugged in, and no other program"):
        plantar.Insole.connect(serial=str(tmp_path / "nowhere"))
    with pytest.raises(ValueError, match="either tcp or serial"):
        plantar.Insole.connect()


@needs_insole
def test_a_closed_connection_and_a_missing_parameter_file_are_errors(tmp_path: pathlib.Path) -> None:
    with simulated(0) as (address, _):
        insole = plantar.Insole.connect(tcp=address)
        with pytest.raises(FileNotFoundError, match=r"params\.toml"):
            insole.push(tmp_path / "params.toml")
        insole.close()
        assert repr(insole) == f"<Insole at {address}: closed>"
        with pytest.raises(RuntimeError, match="the connection was closed"):
            insole.next_event()

        async def iterate() -> None:
            async for _ in insole:
                pass

        with pytest.raises(RuntimeError, match="the connection was closed"):
            asyncio.run(iterate())
