"""Magnets and other movers: linear drive, states by brute force, neighbours that push each other, bad input.

| what | against | tolerance and why |
|---|---|---|
| selectivity of eight plain tones, 24 states | FFT of the WAV behind a high-pass, resonators | 0.05 dB: 24 bit |
| lines that are not wanted | the same FFT | −100 dB: 24 bit |
| what OFF magnets hear of their neighbours | all magnets of a grid, coupled, solved at once | 0.2 dB |
| the same | 5 x 5 cells stepped in time by Runge and Kutta, all tones at once | 0.2 dB |
| rest over a core | the balance of spring and core's pull where it hangs | 1 %: lines between gaps |
| springs by a shared core | `shared_core` and one solved coil | 1e-6 |
| force per ampere | thin loops by Biot and Savart on a cloud of dipoles | 0.5 %: 800 loops, 60 places |
"""

import re
from itertools import product
from math import pi

import numpy as np
import pytest

import padgen as pg
from padgen.cli import run
from padgen.core.errors import SpecError
from padgen.core.registry import MOVERS
from padgen.core.units import GRAM, MM, UM, decibel
from padgen.physics.magnet_pull import magnet_pull, rest_on_spring, shared_core
from padgen.physics.magnetics import solenoid
from padgen.physics.magnets import demagnetising_factor, neighbour_pull
from padgen.physics.selectivity import all_states
from padgen.planner import make_plan, movers
from padgen.planner.coils import coil_source
from padgen.planner.cures import varied
from padgen.planner.drive_scheme import cell_is_turned, neighbour_energies, placed_channels
from padgen.planner.movers import magnet, washer
from padgen.planner.plan import plan_to_json
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import make_spec
from padgen.spec.load import laid_over, read_table

FOUR = {"name": "four", "resolution": 32, "band_hz": [80, 320], "q_min": 15, "delta_y": 5}
MAGNETS = {**FOUR, "magnet": "disc-3x1", "coil": "air-10"}
CORNER_HZ = 10.0
EIGHT = {
    "name": "eight",
    "resolution": 8,
    "band_hz": [60, 700],
    "q_min": 15,
    "delta_y": 4,
    "magnet": "disc-2x1",
    "pad": {"width_mm": 34, "depth_mm": 34},
    "coil": {
        "name": "own",
        "outer_diameter_mm": 30,
        "inner_diameter_mm": 20,
        "length_mm": 5,
        "turns": 200,
        "resistance_ohm": 8,
        "inductance_mh": 0.8,
        "core_diameter_mm": 0,
        "core_relative_permeability": 1,
        "grid": [1, 1],
        "gap_mm": 1,
    },
    "sound_card": {"name": "own", "channels": 2, "coupling": "AC", "corner_hz": CORNER_HZ},
}


@pytest.fixture(scope="module")
def eight():
    return make_plan(make_spec(EIGHT), tries_cures=False)


@pytest.fixture(scope="module")
def pad():
    return make_plan(make_spec(MAGNETS), tries_cures=False)


def looped_current(path, full_scale_v, ohm, henry):
    """Return the lines of the current (frequencies in Hz, complex A) of a WAV that loops, from its bytes alone."""
    data = path.read_bytes()
    at = data.index(b"fmt ") + 8
    channels = int.from_bytes(data[at + 2 : at + 4], "little")
    rate_hz = int.from_bytes(data[at + 4 : at + 8], "little")
    assert channels == 1
    start = data.index(b"data") + 8
    raw = np.frombuffer(data[start:], np.uint8)
    raw = raw[: len(raw) // 3 * 3].reshape(-1, 3).astype(np.int32)
    sample = raw[:, 0] | raw[:, 1] << 8 | raw[:, 2] << 16
    volts = np.where(sample >= 1 << 23, sample - (1 << 24), sample) / (1 << 23) * full_scale_v
    lines = np.fft.rfft(volts) * 2 / len(volts)
    hz = np.arange(len(lines)) * rate_hz / len(volts)
    behind_card = lines[1:] / (1 - 1j * CORNER_HZ / hz[1:])
    return hz[1:], behind_card / (ohm + 2j * pi * hz[1:] * henry)


def some_states():
    """Return the states of eight channels with one OFF, with one ON, and eight more."""
    one_on = ["".join("1" if k == j else "0" for k in range(8)) for j in range(8)]
    one_off = [state.translate({48: 49, 49: 48}) for state in one_on]
    drawn = np.random.default_rng(3).integers(1, 255, 8)
    return [*one_on, *one_off, *(f"{state:08b}" for state in drawn)]


def test_states_of_eight_plain_tones_are_as_planned(eight, tmp_path):
    check_states(eight, tmp_path, some_states())


@pytest.mark.soak
def test_all_states_of_eight_plain_tones_are_as_planned(eight, tmp_path):
    check_states(eight, tmp_path, ["".join(bits) for bits in product("01", repeat=8)][1:])


def check_states(eight, tmp_path, states):
    """Compare the plan with the WAVs' bytes, which move eight resonators behind a high-pass that the plan knows."""
    assert eight.selectivity.drive == "linear"
    channels = eight.channels
    count = len(channels)
    assert count == 8
    hz = np.array([c.resonance_hz for c in channels])
    mass = np.array([c.effective_mass_g for c in channels]) * GRAM
    constant = np.array([c.force_constant_n_per_a2 for c in channels])
    level_um = np.array([c.level_um for c in channels])
    coil = eight.spec.coil
    quietest_on = np.inf
    loudest_off = 0.0
    unwanted = 0.0
    for state in states:
        on = np.array(list(state)) == "1"
        written = pg.drive(eight, state=state, loop=True).save(tmp_path / "drive.wav")
        full_scale_v = written.report.full_scale
        henry = coil.inductance_mh * 1e-3
        at_hz, current = looped_current(tmp_path / "drive.wav", full_scale_v, coil.resistance_ohm, henry)
        answer = 1 / (4 * pi**2 * mass[:, None]) / (hz[:, None] ** 2 - at_hz**2 + 1j * at_hz * hz[:, None] / 15)
        motion = np.sqrt((np.abs(constant[:, None] * current * answer) ** 2).sum(1)) / UM / level_um
        quietest_on = min(quietest_on, motion[on].min())
        if not on.all():
            loudest_off = max(loudest_off, motion[~on].max())
        size = np.abs(current)
        wanted = np.abs(at_hz[:, None] - hz[on]).min(1) < 0.02 * hz.min()
        unwanted = max(unwanted, size[~wanted].max() / size.max())
    planned = all_states(placed_channels(eight.spec, channels), eight.scheme).db
    assert decibel(quietest_on / loudest_off) == pytest.approx(planned, abs=0.05)
    assert decibel(unwanted) < -100


def test_off_magnets_hear_their_neighbours_as_coupled_resonators_do(pad):
    """All magnets of a grid of 11 x 11 cells are solved at once; the middle cell's taxels are OFF one by one."""
    channels = pad.channels
    spec = pad.spec
    pitch_mm = np.array([pad.coils.pitch_x_mm, pad.coils.pitch_y_mm])
    grid = (11, 11)
    found = neighbour_energies(spec, channels, pitch_mm, grid, pad.reuse.turned)
    hz, q, stiffness, level = np.array([(c.resonance_hz, c.q, c.stiffness_n_per_m, c.level_um) for c in channels]).T
    places = []
    kinds = []
    for row, column in product(range(11), repeat=2):
        sign = -1 if cell_is_turned(pad.reuse.turned, row, column) else 1
        for c in channels:
            if c.index % spec.coil.sets == (row + column) % spec.coil.sets:
                places.append(np.array([column, row]) * pitch_mm + sign * np.array(c.site.washer_mm))
                kinds.append(c.index)
    places = np.array(places)
    kinds = np.array(kinds)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    spring = np.zeros(apart.shape)
    spring[apart > 0] = magnet.coupling(spec.magnet, apart[apart > 0] * MM)
    middle = [k for k in range(len(places)) if np.linalg.norm(places[k] - 5 * pitch_mm) < pitch_mm.min() / 2]
    for off in middle:
        i = kinds[off]
        energy = 0.0
        for j in range(len(channels)):
            # Every taxel of channel j but this one is held at its level; the others are free and start at rest.
            ratio = hz[j] / hz[kinds]
            own = stiffness[kinds] * (1 - ratio**2 + 1j * ratio / q[kinds])
            held = (kinds == j) & (np.arange(len(kinds)) != off)
            free = ~held
            system = np.diag(own[free]) - spring[np.ix_(free, free)]
            push = spring[np.ix_(free, held)] @ np.full(held.sum(), level[j])
            motion = np.linalg.solve(system, push)
            energy += np.abs(motion[np.flatnonzero(free) == off][0] / level[i]) ** 2
        assert decibel(found.in_step[i] ** 0.5) == pytest.approx(decibel(energy**0.5), abs=0.2)


def test_off_magnets_hear_their_neighbours_as_in_time(pad):
    """A grid of 5 x 5 cells, stepped in time with all taxels but one ON; forces are re-tuned to the levels once."""
    spec = pad.spec
    channels = pad.channels
    pitch_mm = np.array([pad.coils.pitch_x_mm, pad.coils.pitch_y_mm])
    found = neighbour_energies(spec, channels, pitch_mm, (5, 5), pad.reuse.turned)
    places = []
    kinds = []
    for row, column in product(range(-2, 3), repeat=2):
        sign = -1 if cell_is_turned(pad.reuse.turned, row % 2, column % 2) else 1
        for c in channels:
            if c.index % spec.coil.sets == (row + column) % spec.coil.sets:
                places.append(np.array([column, row]) * pitch_mm + sign * np.array(c.site.washer_mm))
                kinds.append(c.index)
    places = np.array(places)
    kinds = np.array(kinds)
    tones_hz = np.array([c.resonance_hz for c in channels])
    level = np.array([c.level_um for c in channels])[kinds]
    stiffness = np.array([c.stiffness_n_per_m for c in channels])[kinds]
    angular = 2 * pi * tones_hz[kinds]
    mass = stiffness / angular**2
    damping = mass * angular / 15
    apart = np.linalg.norm(places[:, None] - places, axis=-1) + 20 * np.eye(len(places))
    spring = magnet.coupling(spec.magnet, apart * MM) * (1 - np.eye(len(places)))
    within = [k for k in range(len(places)) if np.linalg.norm(places[k]) < pitch_mm.min() / 2]
    force = np.repeat(level * stiffness / 15 + 0j, len(within)).reshape(len(places), -1)
    force[within, range(len(within))] = 0.0
    for _ in range(2):
        lines = stepped(mass, damping, stiffness, spring, force, angular, tones_hz)
        own = lines[kinds, range(len(places))]
        off = np.where(force != 0, level[:, None] - own, 0.0)
        force = force + off * (stiffness / 15)[:, None]
    lines = stepped(mass, damping, stiffness, spring, force, angular, tones_hz)
    own = np.abs(lines[kinds, range(len(places))])
    assert own[force != 0] == pytest.approx(np.broadcast_to(level[:, None], own.shape)[force != 0], rel=2e-3)
    for at, off in enumerate(within):
        heard = np.sqrt((np.abs(lines[:, off, at]) ** 2).sum()) / level[off]
        assert decibel(heard) == pytest.approx(decibel(found.in_step[kinds[off]] ** 0.5), abs=0.2)


def stepped(mass, damping, stiffness, spring, force, angular, tones_hz):
    """Return lines (tones, n, s) of n resonators under forces (n, s), each at its own tone, by Runge-Kutta steps.

    A force is the amplitude of a cosine; a line is that of the motion, a quarter of a period later.
    """
    step = 1 / (24 * tones_hz.max())
    settled = round(0.5 / step)
    count = settled + round(0.4 / step)
    place, speed = np.zeros((2, *force.shape))
    kept = np.empty((count - settled, *force.shape))

    def pushed(place, speed, time):
        driven = (force * np.exp(1j * angular * time)[:, None]).real
        return (driven - damping[:, None] * speed - stiffness[:, None] * place + spring @ place) / mass[:, None]

    for n in range(count):
        time = n * step
        a = pushed(place, speed, time)
        b = pushed(place + step / 2 * speed, speed + step / 2 * a, time + step / 2)
        c = pushed(place + step / 2 * (speed + step / 2 * a), speed + step / 2 * b, time + step / 2)
        d = pushed(place + step * (speed + step / 2 * b), speed + step * c, time + step)
        place = place + step * (speed + step / 6 * (a + b + c))
        speed = speed + step / 6 * (a + 2 * b + 2 * c + d)
        if n >= settled:
            kept[n - settled] = place
    times = (np.arange(settled, count) + 1) * step
    waves = np.exp(2j * pi * np.outer(times, tones_hz))
    parts = np.linalg.lstsq(np.concatenate([waves.real, -waves.imag], 1), kept.reshape(len(times), -1), rcond=None)[0]
    count = len(tones_hz)
    return 1j * (parts[:count] + 1j * parts[count:]).reshape(count, *force.shape)


def test_force_per_ampere_is_that_of_thin_loops_on_a_cloud_of_dipoles(pad):
    """By Biot and Savart: 40 x 20 loops of 90 pieces; the magnet is 5 x 12 places on each face, of even charge."""
    coil = pad.spec.coil
    part = pad.spec.magnet
    disc = magnet.magnet_of(part)
    gap_m = 1.0 * MM
    offset_m = 2.0 * MM
    found = magnet.pulls(coil, part, np.array([gap_m]), np.array([[offset_m, 0.0]])).pull[0]
    radius = (np.arange(40) + 0.5) / 40 * (coil.outer_diameter_mm - coil.inner_diameter_mm) / 2 * MM
    radius = radius + coil.inner_diameter_mm / 2 * MM
    height = -(np.arange(20) + 0.5) / 20 * coil.length_mm * MM
    angle = (np.arange(90) + 0.5) * 2 * pi / 90
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    along = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], -1) * 2 * pi / 90
    r, h = np.meshgrid(radius, height, indexing="ij")
    source = r.reshape(-1, 1, 1) * ring + np.stack([0 * h, 0 * h, h], -1).reshape(-1, 1, 3)
    piece = np.broadcast_to(r.reshape(-1, 1, 1) * along, source.shape)

    def axial_field(z):
        fields = []
        for share, turn in product((np.arange(5) + 0.5) / 5, (np.arange(12) + 0.5) / 12):
            arm = disc.outer_diameter / 2 * share**0.5
            place = np.array([offset_m + arm * np.cos(2 * pi * turn), arm * np.sin(2 * pi * turn), z])
            away = place - source
            cross = np.cross(piece, away)[..., 2] / np.linalg.norm(away, axis=-1) ** 3
            fields.append(1e-7 * cross.sum() * coil.turns / (40 * 20))
        return np.mean(fields)

    pulled = -disc.moment / disc.height * (axial_field(gap_m + disc.height) - axial_field(gap_m))
    assert found == pytest.approx(pulled, rel=0.005)


def test_a_toy_mover_is_one_object(pad):
    """Half a washer's pull: a plan takes twice the line, and nothing else changes."""

    class Half:
        FORCE_ORDER = 2
        PART = "washer"
        leakage = staticmethod(washer.leakage)
        assembly = staticmethod(washer.assembly)
        remanent_currents = staticmethod(washer.remanent_currents)

        @staticmethod
        def pulls(coil, part, gap_m, place_m):
            whole = washer.pulls(coil, part, gap_m, place_m)
            return whole._replace(
                pull=whole.pull / 2, side=whole.side / 2, moment=whole.moment / 2, slope=whole.slope / 2
            )

    plain = make_plan(make_spec(FOUR | {"coil": {"grid": [4, 4]}}))
    movers.register("half", Half())
    try:
        half = make_plan(make_spec(FOUR | {"coil": {"grid": [4, 4]}, "mover": "half"}))
    finally:
        movers.unregister("half")
    assert [c.line_a2 for c in half.channels] == pytest.approx([2 * c.line_a2 for c in plain.channels], rel=1e-9)
    assert half.reuse == plain.reuse
    assert "half" not in MOVERS.names()


def test_a_magnet_pad_needs_milliwatts_and_any_output(pad):
    """It keeps what is asked and takes no idle heat; washers of the same four lines take a watt."""
    assert pad.prints.print_db > decibel(pad.spec.delta_y)
    assert pad.scheme.force_order == 1
    assert pad.load.idle_w == 0
    assert pad.load.copper_loss_w * pad.coils.rows * pad.coils.columns < 0.02
    assert all(c.drive_hz == c.resonance_hz for c in pad.channels)
    assert all(c.static_um < 1e-12 and c.pull_shift < 1e-12 for c in pad.channels)


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        ({"coil": "paper", "ballast": "nut-m2"}, "ballast", "must not be magnetic over a coil with a core"),
        ({"magnet": {"name": "disc-3x1", "polarity": ""}}, "magnet.polarity", "alternating"),
        ({"magnet": {"name": "disc-3x1", "grade": "n99"}}, "magnet.grade", "there is no grade of magnets 'n99'"),
        ({"magnet": {"name": "disc-3x1", "remanence_high_t": 1.6}}, "magnet.remanence_high_t", "1.5"),
        ({"magnet": {"name": "disc-3x1", "remanence_low_t": 1.4}}, "magnet.remanence_low_t", "must be at most"),
        ({"drive": "spur-free"}, "drive.scheme", "goes with the current"),
        ({"washer": "iso7092-m1.6"}, "washer", "is not what mover.kind = 'magnet' moves"),
        ({"mover": "washer"}, "magnet", "is not what mover.kind = 'washer' moves"),
        ({"mover": "spring"}, "mover.kind", "'spring'"),
        ({"magnet": "disc-9x9"}, "magnet.name", "there is no magnet 'disc-9x9'"),
    ],
)
def test_bad_movers_are_one_sentence(change, where, words):
    with pytest.raises(SpecError) as told:
        make_spec(MAGNETS | change)
    assert told.value.where == where
    assert words in str(told.value)


def test_another_grade_on_a_plan_has_its_own_figures(pad, tmp_path):
    """A plan.json has all figures of its grade; those that a user changed stay."""
    (tmp_path / "plan.json").write_text(plan_to_json(pad))
    table = read_table(tmp_path / "plan.json", "plan.json")
    assert table["magnet"]["remanence_low_t"] == 1.28
    strong = make_spec(laid_over(table, {"magnet.grade": "n52"}))
    assert (strong.magnet.grade, strong.magnet.remanence_low_t, strong.magnet.limit_c) == ("n52", 1.42, 60)
    assert varied(pad.spec, {"magnet.grade": "n35"}).magnet.remanence_high_t == 1.22
    weak = make_spec(laid_over(table, {"magnet.grade": "n35", "magnet.remanence_low_t": 1.1}))
    assert (weak.magnet.remanence_low_t, weak.magnet.remanence_high_t) == (1.1, 1.22)
    table["magnet"]["limit_c"] = 77.0
    assert make_spec(laid_over(table, {"magnet.grade": "n52"})).magnet.limit_c == 77


def test_a_refused_magnet_writes_nothing(tmp_path, capsys):
    spec = tmp_path / "mag.toml"
    spec.write_text(
        'name = "mag"\nresolution = 16\nband_hz = [50, 200]\nq_min = 15\ndelta_y = 5\nmagnet = "disc-3x1"\n'
    )
    assert run(["plan", str(spec), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert re.search(r"coil = 'air-10',? would do", told)
    gap_mm, away_mm, beam, least, farther_mm = map(float, re.search(SNAPS, told).groups())
    assert gap_mm == 1
    coil = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
    disc = magnet.magnet_of(make_spec(MAGNETS).magnet)
    # Without its sag the magnet hangs farther up, so that a spring softer by some per cent would hold, too.
    for share, holds in ((1.0, True), (0.8, False), (beam / least, False)):
        rest = rest_on_spring(coil, disc, gap_mm * MM, np.array([away_mm * MM]), np.array([share * least]))
        assert np.isfinite(rest.gap[0]) == holds
    for share, holds in ((1.0, True), (0.85, False)):
        rest = rest_on_spring(coil, disc, share * farther_mm * MM, np.array([away_mm * MM]), np.array([beam]))
        assert np.isfinite(rest.gap[0]) == holds


SNAPS = (
    r"at a gap of (\S+) mm the core pulls .*, (\S+) mm off its coil's axis, onto itself: its beam has (\S+) N/m, (\S+)"
    r" N/m would hold it; from a gap of (\S+) mm on the beam holds it"
)


ON_ONE_SET = {"name": "paper", "reuse": "same"}


@pytest.fixture(scope="module")
def over_cores():
    table = MAGNETS | {"resolution": 16, "band_hz": [150, 600], "magnet": "disc-2x1", "coil": ON_ONE_SET}
    return make_plan(make_spec(table))


def test_magnets_rest_where_spring_and_core_balance(over_cores):
    spec = over_cores.spec
    assert spec.coil.core_diameter_mm == 4
    disc = magnet.magnet_of(spec.magnet)
    for c in over_cores.channels:
        beam = BeamShape(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm)
        bare = TaxelModel(spec, c.beam.topology, plate_shape(spec), beam)
        spring = float(bare.stiffness_n_per_m)
        gap_m = spec.coil.gap_mm * MM - (c.sag_um + c.static_um) * UM
        drawn = magnet_pull(coil_source(spec.coil), disc, gap_m, c.site.coil_distance_mm * MM)
        assert c.static_um > 1
        assert spring * c.static_um * UM == pytest.approx(drawn.core_pull[0], rel=0.01)
        assert c.stiffness_n_per_m == pytest.approx(spring + drawn.core_stiffness[0], rel=0.002)
        soft = (c.stiffness_n_per_m / spring) ** 0.5
        assert c.resonance_hz == pytest.approx(float(bare.resonance_hz) * soft, rel=1e-6)
        assert c.pull_shift == pytest.approx(1 - soft, abs=1e-9)
    (found,) = [finding for finding in over_cores.findings if finding.code == "coil.core"]
    assert "nearer it snaps to the core" in found.message


def test_magnets_over_one_core_push_each_other(over_cores):
    """One coil alone, its four magnets joined by what `shared_core` and their own push make."""
    spec = over_cores.spec
    channels = over_cores.channels
    pitch_mm = np.array([over_cores.coils.pitch_x_mm, over_cores.coils.pitch_y_mm])
    found = neighbour_energies(spec, channels, pitch_mm, (1, 1), "none")
    place = np.array([c.site.washer_mm for c in channels]) * MM
    count = len(channels)
    gap = np.full(count, spec.coil.gap_mm * MM)
    disc = magnet.magnet_of(spec.magnet)
    by_core = shared_core(coil_source(spec.coil), disc, gap, place, np.ones(count)).stiffness
    by_push = neighbour_pull(disc, place, np.ones(count)).stiffness
    joined = (by_core + by_push) * (1 - np.eye(count))
    assert np.abs(by_core * (1 - np.eye(count))).max() > 0.2
    hz, q, stiffness, level = np.array([(c.resonance_hz, c.q, c.stiffness_n_per_m, c.level_um) for c in channels]).T
    for off in range(count):
        energy = 0.0
        for j in set(range(count)) - {off}:
            ratio = hz[j] / hz
            system = np.diag(stiffness * (1 - ratio**2 + 1j * ratio / q)) + joined
            free = [k for k in range(count) if k != j]
            motion = np.linalg.solve(system[np.ix_(free, free)], -joined[free, j] * level[j])
            energy += np.abs(motion[free.index(off)] / level[off]) ** 2
        assert found.in_step[off] == pytest.approx(energy, rel=1e-6)


def test_a_magnet_that_is_too_warm_is_an_error_with_a_cure():
    """A flat disc of a strong grade in a warm room; by hand, half of it is past its knee at 25.9 °C."""
    flat = {"name": "disc-5x1", "grade": "n52"}
    plan = make_plan(make_spec(MAGNETS | {"magnet": flat, "resolution": 4, "limits": {"room_c": 40}}))
    (found,) = [finding for finding in plan.findings if finding.code == "magnet.hot"]
    assert found.level == "error"
    # Its own field N J/μ0 meets nine tenths of the coercivity, both at that temperature; N = 0.70 of 5 x 1 mm.
    disc = magnet.magnet_of(plan.spec.magnet)
    factor = demagnetising_factor(disc)
    warm = magnet.demagnetising_limit_c(plan.spec.magnet) - 20
    own = factor * disc.polarisation * (1 - 0.0012 * warm) / (4e-7 * pi)
    assert own == pytest.approx(0.9 * 876e3 * (1 - 0.0075 * warm), rel=1e-6)
    assert magnet.demagnetising_limit_c(plan.spec.magnet) == pytest.approx(25.9, abs=0.1)
