"""Describe plans, builds and findings to people: as text, and as HTML for notebooks."""

from collections.abc import Callable, Iterable, Sequence
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Any

from padgen.core.display import span_text, table
from padgen.core.errors import (
    LEVELS,
    Finding,
    SpecError,
    Verdict,
    about,
    at_most,
    less_or_more_text,
    listed,
    number,
    plain,
    plural,
)
from padgen.core.units import COPPER_MELTS_C

if TYPE_CHECKING:
    from padgen.make.pad import Built
    from padgen.planner.explain import Change, Explanation, MoverRow
    from padgen.planner.plan import Channel, FrameRate, Plan, Touch
    from padgen.planner.print_yield import PrintYield

__all__ = [
    "built_text",
    "explanation_text",
    "figures_text",
    "findings_text",
    "outcome_line",
    "output_coupling",
    "pad_line",
    "plan_html",
    "plan_text",
    "serious_text",
    "summary_text",
    "verdict_text",
    "warm_drive_line",
    "yield_text",
]


def summary_text(plan: "Plan") -> str:
    """Return the verdict on a plan, the pad in a line, a table of its channels, its power, and what prints keep."""
    rows = _channels_table(plan.channels, SUMMARY, narrow=True).split("\n")
    if len(plan.channels) > SHOWN_CHANNELS:  # those in the middle are left out
        heading_rows = len(rows) - len(plan.channels)
        rows[heading_rows + SHOWN_CHANNELS // 2 : -SHOWN_CHANNELS // 2] = [" …"]
    return "\n".join(
        [verdict_text(plan.verdict), "", pad_line(plan), "", *rows, *_serpentine_lines(plan), "", *_power_lines(plan)]
    )


def _serpentine_lines(plan: "Plan") -> list[str]:
    """Return a line on what the number in the name of a serpentine means; none for other suspensions."""
    for topology in dict.fromkeys(channel.beam.topology for channel in plan.channels):
        if topology.startswith("serpentine-"):
            legs = topology.removeprefix("serpentine-")
            return [f"{topology}: a beam of {legs} legs side by side; l is its length along all of them."]
    return []


def verdict_text(verdict: Verdict) -> str:
    """Return the verdict in up to three sentences, a line each: whether the pad works, what a finger and recoil do."""
    return "\n".join(filter(None, (verdict.sentence, verdict.shaken, verdict.touched)))


def output_coupling(plan: "Plan") -> str:
    """Return which coupling the amplifier's outputs need: 'DC', where they pass a constant current, or 'AC or DC'."""
    from padgen.planner.plan import carrier_hz

    carrier = carrier_hz(plan.spec, plan.scheme, plan.channels[-1].resonance_hz)
    return "DC" if plan.scheme.has_constant and carrier is None else "AC or DC"


def pad_line(plan: "Plan") -> str:
    """Return one sentence on taxels, pitch, coils, gap and amplifier outputs."""
    from padgen.planner.plan import carrier_hz

    pad = plan.spec.pad
    coils = plan.coils
    pitch = plan.pitch
    sides = [
        f"{name} " + "-".join(dict.fromkeys(f"{v:.1f}" for v in step)) + " mm"
        for name, step in (("columns", pitch.x_mm), ("rows", pitch.y_mm))
        if step
    ]
    is_even = pitch.ratio <= EVEN
    nearest_mm = nearest_taxels_mm(plan)
    nearest = "each taxel " + "-".join(dict.fromkeys(f"{v:.1f}" for v in nearest_mm)) + " mm from its nearest"
    is_full = pitch.taken > 1 - 1e-9
    spaced = ""
    if sides and is_full:
        spaced = f", {' and '.join(sides)} apart ({'even' if is_even else 'uneven'})"
    elif sides and is_even:
        diagonal_mm = hypot(pitch.x_mm[0], pitch.y_mm[0]) if len(sides) == 2 else inf
        like = "staggered like a chessboard, " if nearest_mm[0] > diagonal_mm - 0.01 else ""
        taken = "" if like else f"a taxel on {pitch.taken:.0%} of their crossings, "
        spaced = f", {' and '.join(sides)} apart (even; {like}{taken}{nearest})"
    elif sides:
        # On no grid: lines of taxels cross where no taxel is, and their distances say little.
        spaced = f", unevenly spaced, {nearest}"
    carrier = carrier_hz(plan.spec, plan.scheme, plan.channels[-1].resonance_hz)
    on_carrier = "" if carrier is None else f", on a carrier of {number(carrier)} Hz"
    outputs = coils.rows * coils.columns
    return (
        f"{len(plan.taxels)} taxel{plural(len(plan.taxels))} on {number(pad.width_mm)} x {number(pad.depth_mm)}"
        f" mm{spaced}; {_coils_text(plan)}, {number(plan.spec.coil.gap_mm)} mm below the"
        f" {plan.spec.mover.kind}s, of {_channels_text(plan)}; {outputs} amplifier output{plural(outputs)},"
        f" {output_coupling(plan)} coupled{on_carrier}."
    )


def _coils_text(plan: "Plan") -> str:
    """Return how many coils there are, as rows x columns, and how wide those on a board are."""
    coils = plan.coils
    text = "1 coil" if coils.rows * coils.columns == 1 else f"{coils.rows} x {coils.columns} coils"
    if plan.spec.coil.kind == "board":
        return f"{text} of {plan.spec.coil.size_text} on a board"
    return text


def _channels_text(plan: "Plan") -> str:
    """Return how many channels a coil has and, where neighbours have different ones, which."""
    coils = plan.coils.rows * plan.coils.columns
    count = len(plan.sets[0])
    up_to = "up to " if len(plan.taxels) < coils * count else ""
    each = " each" if coils > 1 else ""
    text = f"{up_to}{count} channel{plural(count)}{each}"
    if len(plan.sets) == 1:
        return text
    one, next_one = (_shortened([str(channel.index) for channel in channels]) for channels in plan.sets)
    return f"{text} (channel{plural(count)} {one} on one coil, {next_one} on the next)"


LISTED = 4
"""Most channels that are listed one by one."""


def _shortened(words: Sequence[str]) -> str:
    """Return words as a list in text, such as '0, 2 and 4'; the middle of a long list is left out.

    >>> _shortened(["0", "2", "4"]), _shortened(["0", "2", "4", "6", "8", "10"])
    ('0, 2 and 4', '0, 2 … 10')
    """
    if len(words) > LISTED:
        return f"{words[0]}, {words[1]} … {words[-1]}"
    return listed(words)


def feeding_line(plan: "Plan") -> str:
    """Return what feeds the coils: sound card, amplifier, supply, and what they must give."""
    spec = plan.spec
    count = plan.coils.rows * plan.coils.columns
    load = plan.load
    amplifiers = [f"{n} x {name}" for name, n in plan.parts.amplifiers.items()]
    amplifier = spec.amplifier.name if spec.amplifier else next(iter(amplifiers), "of your own")
    card = spec.sound_card
    cards = plan.parts.sound_cards
    named = card.name if card else next(iter(cards), "")
    return (
        f"Sound card{f' ({named})' if named else ''}, output k → amplifier ({amplifier}), input k; its output k → both"
        f" leads of coil k, {count} times. The supply feeds the amplifier alone, which gives each coil up to"
        f" {load.voltage_peak_v:.2g} V and {load.current_peak_ma:.3g} mA peak, and all of them"
        f" {about(plan.heat_w)} W with all taxels on."
    )


def gain_line(plan: "Plan") -> str:
    """Return how the amplifier's gain is set, so that files are played at the level that they state."""
    card = plan.spec.sound_card
    full_v = plan.spec.drive.voltage_limit_v
    gain = (
        f"A sample of 1 in padgen's WAV files stands for {number(full_v)} V at a coil: before coils are connected, play"
        f" a sine of 100 Hz at a tenth of full scale (-20 dB) and set each output of the amplifier to"
        f" {about(full_v / 10)} V peak, {about(full_v / 10 / 2**0.5)} V rms"
    )
    if card and card.full_scale_v:
        gain += f"; that is {about(full_v / card.full_scale_v)} times what {card.name} gives"
    return f"{gain}."


def nearest_taxels_mm(plan: "Plan") -> tuple[float, float]:
    """Return the smallest and the largest distance in mm between a taxel and its nearest neighbour."""
    from numpy import array, inf

    places_mm = array([(taxel.x_mm, taxel.y_mm) for taxel in plan.taxels])
    nearest = []
    for k, place_mm in enumerate(places_mm):
        square = ((places_mm - place_mm) ** 2).sum(1)
        square[k] = inf
        nearest.append(float(square.min()) ** 0.5)
    return min(nearest), max(nearest)


EVEN = 1.2
"""Largest ratio of distances of neighbouring rows or columns that is called even."""


def _channels_table(channels: "Sequence[Channel]", names: Sequence[str], narrow: bool = False) -> str:
    """Return a table of the channels with the columns of these names, headings in two lines where `narrow`."""
    headings = [name.replace(" ", "\n", 1) if narrow else name for name in names]
    return table(headings, [[COLUMNS[name](channel) for name in names] for channel in channels])


COLUMNS: "dict[str, Callable[[Channel], str]]" = {
    "ch": lambda c: str(c.index),
    "resonance Hz": lambda c: f"{c.resonance_hz:.2f}",
    "by model": lambda c: c.model if c.beam_error is None else f"{c.model} (beam {c.beam_error:+.1%})",
    "model ± %": lambda c: f"{100 * c.model_error:.2g}",
    "prints ± sigma %": lambda c: f"{100 * c.print_spread:.1f}",
    "current Hz": lambda c: f"{c.drive_hz:.2f}",
    "paper's formula Hz": lambda c: f"{c.rule_hz:.1f}",
    "nearest mode Hz": lambda c: f"{c.second_mode_hz:.1f}",
    "m mg": lambda c: f"{1e3 * c.effective_mass_g:.1f}",
    "k N/m": lambda c: number(c.stiffness_n_per_m),
    "ring-up 63 % ms": lambda c: f"{c.ring_up_ms:.1f}",
    "level µm peak": lambda c: f"{c.level_um:.2f}",
    "force µN peak": lambda c: f"{1e3 * c.force_mn:.2f}",
    "suspension": lambda c: c.beam.topology,
    "beam w x t x l mm": lambda c: f"{c.beam.width_mm:.3f} x {c.beam.thickness_mm:.2f} x {c.beam.length_mm:.2f}",
    "layers": lambda c: str(c.beam.layers),
    "sag µm": lambda c: f"{c.sag_um:.1f}",
    "MPa at level": lambda c: f"{c.root_stress_mpa:.3f}",
    "off axis mm": lambda c: f"{c.site.coil_distance_mm:.2f}",
}
"""The columns of the tables of channels, by heading."""
SHAPE = ("suspension", "beam w x t x l mm", "layers")
SUMMARY = ("ch", "resonance Hz", "model ± %", "prints ± sigma %", "current Hz", *SHAPE, "level µm peak")
MODES = ("ch", "resonance Hz", "by model", "model ± %", "paper's formula Hz", "nearest mode Hz")
MOTION = (*MODES, "current Hz", "ring-up 63 % ms", "level µm peak", "force µN peak")
BEAMS = ("ch", *SHAPE, "m mg", "k N/m", "prints ± sigma %", "sag µm", "MPa at level", "off axis mm")
SHOWN_CHANNELS = 12


def _power_lines(plan: "Plan") -> list[str]:
    """Return lines on the pad's power, warmth and touch, and on the selectivity that its prints keep."""
    from padgen.physics.schemes import in_words
    from padgen.planner.verdict import moving_pad_db, works_by_table

    load = plan.load
    prints = plan.prints
    count = plan.coils.rows * plan.coils.columns
    lines = [
        f"Drive: {plan.selectivity.drive}, {in_words(plan.scheme)}. All taxels on: {plan.heat_w:.2g} W in the coils"
        f" (a coil draws up to {load.current_rms_ma:.0f} mA rms, {load.current_peak_ma:.0f} mA and"
        f" {load.voltage_peak_v:.2g} V peak);"
        f" idle: {count * load.idle_w:.2g} W."
    ]
    warm = plan.warm
    if warm.coil_c > COPPER_MELTS_C:
        lines.append(f"If all taxels stay on, coils burn: copper melts at {COPPER_MELTS_C:.0f} °C.")
    elif -warm.resonance_shift > plan.spec.model.tolerance:
        lines.append(
            f"If all taxels stay on, coils reach {warm.coil_c:.0f} °C and beams {warm.beam_c:.0f} °C (rises"
            f" ± {warm.error:.0%}, two thirds within {warm.warm_up_min:.0f} min): resonances fall by up to"
            f" {about(-100 * warm.resonance_shift)}%. Re-tune the pad warm, or write its drive by padgen drive --warm."
        )
    lasting = []
    if plan.life.good_share >= plan.spec.print_share and plan.life.print_db is not None:
        today_db = plan.retuned_prints.print_db
        # Fewer prints are simulated for that than for what prints keep today: by chance they may keep more.
        kept_db = plan.life.print_db if today_db is None else min(plan.life.print_db, today_db)
        lasting.append(
            f"Re-tuned once, {plan.spec.print_share:.0%} of {plan.spec.touch.prints_text} still keep"
            f" {kept_db:z.1f} dB when {plan.spec.life.changes_text}."
        )
    if plan.touch is not None:
        lines += _touch_lines(plan, plan.touch) + lasting
    if prints.print_db is not None:
        stages = zip(STAGES, (prints.planned_db, prints.coupon_db, prints.some_db, prints.print_db), strict=True)
        stages_text = ", ".join(f"{stage} {db:z.1f}" for stage, db in stages if db is not None)
        on_over_off = "ON over OFF in dB" if plan.touch is None else "Untouched, ON over OFF in dB"
        lines.append(
            f"{on_over_off} that {plan.spec.print_share:.0%} of prints keep, by what was measured to re-tune them:"
            f" {stages_text} (± {prints.error_db:.1g} dB with 95 % confidence, by {prints.pads}"
            " prints in the computer)."
        )
        if plan.touch is None:
            lines += lasting
    left_db = moving_pad_db(plan)
    is_told = plan.spec.mount.is_immovable or plan.verdict.shaken or plan.touch is not None
    if left_db is not None and prints.print_db is not None and not is_told:
        where = "on its mount" if plan.spec.mount.is_said else "lying loose"
        by_table = works_by_table(plan)
        held = f"{prints.planned_db if by_table else prints.print_db:z.1f}"
        keeps = f"keeps {left_db:z.1f} dB instead of {held} dB"
        if held == f"{left_db:z.1f}":
            keeps = "loses nothing by that"
        lines.append(f"The dB that prints keep are of a pad that is held still; {where} it recoils, and {keeps}.")
    return lines


def _touch_lines(plan: "Plan", touch: "Touch") -> list[str]:
    """Return lines on a pad under its contact: touched resonances, levels and currents, and what it keeps."""
    from padgen.planner.pins import felt_parts

    rows = [
        [
            str(k),
            f"{touch.resonance_hz[k]:.2f}",
            f"{touch.q[k]:.2f}",
            f"{touch.tone_hz[k]:.2f}",
            f"{touch.level_um[k]:.3g}",
            f"{touch.bare_um[k]:.3g}",
            f"{touch.force_mn[k]:.3g}",
            f"{touch.current_ma[k]:.3g}",
        ]
        for k in range(len(touch.q))
    ]
    share = plan.spec.print_share
    judged = plan.spec.touch.prints_text
    skin = "its own contact" if touch.contact == "own" else f"a {touch.contact}"
    headings = [
        "ch",
        "touched\nHz",
        "Q",
        "tone\nHz",
        "touched\nlevel µm",
        "untouched\nlevel µm",
        "force\nmN",
        "mA\npeak",
    ]
    kept = ""
    if touch.print_db is not None:
        planned = "" if touch.planned_db is None else f"; {touch.planned_db:z.1f} dB with the planned tones"
        other = ""
        if touch.other_db is not None:
            kind = "untouched" if touch.tones == "touched" else "touched"
            other = f"; {touch.other_db:z.1f} dB with every tone on its taxel's {kind} resonance"
        kept = (
            f"ON over OFF under {skin} that {share:.0%} of {judged} keep: {touch.print_db:z.1f} dB with every tone on"
            f" its taxel's {touch.tones} resonance, as it was measured (± {touch.error_db:.1g} dB with 95 % confidence,"
            f" by {touch.pads} pads in the computer){planned}{other}."
        )
    skinned = "" if touch.contact == "own" else " of typical skin (a provisional model)"
    louder = ""
    if touch.in_hand_db > 0:
        louder = (
            f". All figures and files drive it {touch.in_hand_db:.1f} dB louder than typical skin needs, so that in"
            f" {share:.0%} of {judged} the faintest taxel, too, reaches its planned level"
        )
    lines = [
        f"Each channel under {skin}{skinned}, on {felt_parts(plan)} of {number(touch.contactor_mm)} mm, with tones at"
        f" {touch.tones} resonances{louder}:",
        table(headings, rows),
        kept,
    ]
    return [line for line in lines if line]


def _warm_levels_line(plan: "Plan") -> str:
    """Return one sentence on the levels that the warm pad reaches when the drive table of the cold pad drives it."""
    warm = plan.warm
    levels = ", ".join(f"{level:.2g}" for level in warm.levels_um)
    return (
        f"once all taxels, left on, have warmed the pad: driven by the currents of drive.csv they reach {levels} µm"
        f" ({span_text(warm.lost_db, 'z.1f')} dB less than planned), driven by its voltages"
        f" {span_text(warm.lost_by_voltage_db, 'z.1f')} dB less than planned, since coils at {warm.mean_coil_c:.0f} °C"
        " (their mean) have more resistance; padgen drive --warm makes up for it"
    )


def warm_drive_line(plan: "Plan") -> str:
    """Return one sentence on the temperatures that the drive of the warm pad is for."""
    warm = plan.warm
    return (
        "tones, levels and voltages are of the pad that all taxels, left on, have warmed: beams at"
        f" {warm.mean_beam_c:.0f} °C and coils at {warm.mean_coil_c:.0f} °C on the mean (rises ± {warm.error:.0%}, two"
        f" thirds within {warm.warm_up_min:.0f} min)"
    )


STAGES = ("nothing", "a coupon", "a few taxels", "every taxel")
"""The parts of a print that are measured, in stages: those of `padgen.planner.printed_pads.STAGES`."""


def plan_text(plan: "Plan") -> str:
    """Return all figures of a plan as tables and lines."""
    from padgen.planner.left_out import left_out_line

    pad = plan.spec.pad
    coils = plan.coils
    capacity = plan.capacity
    figures = plan.selectivity
    count = len(plan.sets[0])
    pitch = number(coils.pitch_mm)
    if coils.pitch_x_mm != coils.pitch_y_mm:
        pitch = f"{number(coils.pitch_x_mm)} x {number(coils.pitch_y_mm)}"
    limit = capacity.limit.replace("coil.grid", f"coil.grid = [{coils.rows}, {coils.columns}]")
    lines = [
        f"{plan.name}: {len(plan.taxels)} taxel{plural(len(plan.taxels))} on {number(pad.width_mm)} x"
        f" {number(pad.depth_mm)} mm; {_coils_text(plan)} at a pitch of {pitch} mm, of {_channels_text(plan)}",
        f"A coil has {count} channel{plural(count)}, and no more because of {limit}. With room for them, so many in"
        f" this band would keep what is asked: {capacity.prints} in {plan.spec.print_share:.0%} of prints (their ratios"
        f" of neighbouring resonances scatter by ± {plan.prints.ratio_spread:.1%}),"
        f" {_count_text(capacity.exact, capacity.searched_to)} if printed exactly (driven {figures.drive}),"
        f" {capacity.exact_one_hot} if only one of them is ON at a time, too; {capacity.paper} by the paper's bound"
        f" ({capacity.paper_unrounded:.2f} rounded down; each resonance {number(capacity.ratio)} times the one below).",
        "",
        _channels_table(plan.channels, MOTION, narrow=True),
        "",
        _channels_table(plan.channels, BEAMS, narrow=True),
        "",
        *_drive_lines(plan),
        _warm_levels_line(plan),
        "",
        _pushes_table(plan),
        "",
        _felt_table(plan),
    ]
    if plan.layouts:
        others = ", ".join(
            f"{o.rows} x {o.columns} coils with {o.channels} channels"
            + ("" if o.kept_db is None else f" ({o.kept_db:.1f} dB in the worst state)")
            for o in plan.layouts
        )
        lines.append(f"runners-up: {others}")
    return "\n".join([*lines, left_out_line(plan.left_out), _settings_line(plan.printing)])


def _pushes_table(plan: "Plan") -> str:
    """Return a table by channel: the gap in mm left under pushes on the boss, and the push in mN that closes it."""
    pushed = plan.pushed
    skins = [f"{SKIN_WORDS[push.skin]}\nskin" for push in pushed.pushes if push.push_mn is None]
    headings = [f"push\n{number(push.push_mn)} mN" for push in pushed.pushes if push.push_mn is not None] + skins
    rows = [
        [str(k), about(force, 3), *("coil" if p.contact[k] else f"{p.gap_left_mm[k]:.2f}" for p in pushed.pushes)]
        for k, force in enumerate(pushed.closing_force_mn)
    ]
    return (
        "gap in mm that is left when the boss is pushed by a force, and when a finger of soft, typical or stiff skin"
        f" rests on the frame (coil: the {plan.spec.mover.kind} touches the coil):\n"
        + table(["ch", "closed\nby mN", *headings], rows)
    )


SKIN_WORDS = {"low": "soft", "typical": "typical", "high": "stiff"}
"""The skins of a plan's pushes by their stiffness."""


def _felt_table(plan: "Plan") -> str:
    """Return a table of what a fingertip feels of each channel, and how many frequencies it tells apart."""
    felt = plan.felt
    touched = "untouched" if plan.touch is None else "touched"
    rows = [
        [
            str(k),
            f"{felt.threshold_um[k]:.2g}",
            f"{felt.error_db[k]:.0f}",
            f"{on_db:.1f}",
            "-" if off_db is None else f"{off_db:.1f}",
            _from_to(felt.least_levels[k], felt.most_levels[k]),
        ]
        for k, (on_db, off_db) in enumerate(zip(felt.on_db, felt.off_db, strict=True))
    ]
    count = _from_to(felt.least_frequencies, felt.most_frequencies)
    return (
        f"levels of {touched} taxels, in dB above what a fingertip just feels (a provisional threshold); a finger tells"
        f" {count} of the {len(plan.channels)} frequencies apart (publications differ where a range is given); the"
        " last column: how many strengths of each:\n"
        + table(["ch", "just felt µm", "± dB", "ON dB", "OFF dB", "strengths"], rows)
    )


def _from_to(least: int, most: int) -> str:
    return str(least) if least == most else f"{least}-{most}"


def _settings_line(printing: dict[str, str]) -> str:
    settings = {key.replace("_", " "): value for key, value in printing.items()}
    printer, material, layers = (settings.pop(key) for key in ("printer", "material", "beam layers"))
    settings_text = ", ".join(f"{key} {value}" for key, value in settings.items())
    return f"print with: {settings_text}; on the printer {printer}, in {material}; the beams have {layers} layers"


def _count_text(count: int, searched_to: int) -> str:
    return f"{count} or more" if count >= searched_to else str(count)


def _drive_lines(plan: "Plan") -> list[str]:
    """Return lines on the drive scheme, its selectivity, and its load on coil and amplifier."""
    from padgen.driver.formats.c import boards_in_time
    from padgen.driver.waveform import CONTROLLER_RATES_HZ, drive_at

    try:
        boards = boards_in_time(drive_at(plan, CONTROLLER_RATES_HZ))
    except SpecError:  # a drive that the firmware does not play
        boards = []
    figures = plan.selectivity
    load = plan.load
    leak_db = plan.reuse.leak_db
    frames = ", ".join(f"{rate.scheme} {number(round(rate.frames_per_s, 2))}" for rate in plan.refresh)
    error = max((c.force_error for c in plan.channels if c.force_constant_n_per_a2 > 0), default=None)
    leaked = ""
    if not plan.reuse.is_known:
        leaked = "how much the coils around make an OFF taxel vibrate is not known"
    elif leak_db is not None:
        leaked = (
            "with the tones of drive.csv on all coils at once, the coils around make an OFF taxel vibrate at worst"
            f" {less_or_more_text(leak_db)} than when it is ON"
        )
    lines = [
        f"drive: {figures.drive}, {figures.why}",
        *([] if figures.one_hot_db is None else _selectivity_lines(plan)),
        leaked,
        f"most frames per second with which a taxel that goes OFF falls to what is asked of OFF taxels within a frame:"
        f" {frames}",
        _frames_text(next(rate for rate in plan.refresh if rate.scheme == figures.drive)),
        f"a coil with all channels on: {load.current_rms_ma:.1f} mA rms, up to {load.current_peak_ma:.1f} mA and"
        f" {load.voltage_peak_v:.2f} V, {load.copper_loss_w:.3f} W",
        f"{load.reachable_by} limits channel 0 to {about(load.reachable_level_um, 3)} µm",
        "any one of these amplifiers of the catalogue drives it: "
        + (", ".join(f"{count} x {name}" for name, count in plan.parts.amplifiers.items()) or "none")
        + f"; fed by one of these sound cards: {', '.join(plan.parts.sound_cards) or 'none'}; or by one of these boards"
        + f" with the firmware: {', '.join(boards) or 'none'}",
        # Currents go with the root of the pull on steel.
        ""
        if error is None
        else f"the coil's pull on a {plan.spec.mover.kind} is known to ± {error:.1%}, and so each current to ±"
        f" {error / plan.spec.force_order:.1%}",
    ]
    return [line for line in lines if line]


def _frames_text(rate: "FrameRate") -> str:
    """Return a sentence on ON over OFF averaged over a frame's time, and on the frame rates that reach the asked dB."""
    if rate.slot_db is None or rate.kept_db is None:
        return ""
    end = "" if rate.end_db is None else f"{rate.end_db:.1f} dB of ON over OFF at its end and "
    of_ratio = " of ON over OFF" if rate.end_db is None else ""
    kept = "at no rate"
    if rate.kept_frames_per_s is not None:
        kept = f"at up to {at_most(rate.kept_frames_per_s)} frames per second"
    text = (
        f"at {rate.frames_per_s:.3g} frames per second the worst frame has {end}{rate.slot_db:.1f} dB{of_ratio}"
        f" averaged over its time; {rate.kept_db:.3g} dB on average are kept {kept}"
    )
    if rate.braked_frames_per_s is None:
        return text
    braked = "" if rate.braked_db is None else f", which have {rate.braked_db:.1f} dB"
    return f"{text}; with padgen drive --brake (WAV only) up to {at_most(rate.braked_frames_per_s)} a second{braked}"


def _selectivity_lines(plan: "Plan") -> list[str]:
    figures = plan.selectivity
    states = figures.all_states_db or 0.0
    one_hot = figures.one_hot_db or 0.0
    paper = figures.paper_db
    law = "all channels felt equally strong"
    if not isinstance(figures.level_law, str):
        law = f"levels {_law_text(figures.level_law)}"
    worst = figures.worst_state
    kept = figures.kept_db
    optimum = figures.optimum_db
    lost = figures.snapping_db or 0.0
    if len(worst) > SHOWN_BITS:
        worst = f"{worst[:10]}…{worst[-10:]} of {len(worst)}"
    # The formula has no value for two equal resonances.
    formula = f" ({paper:.1f} dB by the paper's formula)" if paper is not None and isfinite(paper) else ""
    dear = (figures.modes_cost_db or 0.0) >= SHOWN_DB
    cost = f" (other modes cost {figures.modes_cost_db:.1f} dB)" if dear else ""
    tables: list[str] = []
    if 2 <= len(plan.sets[0]) <= SHOWN_MATRIX:
        for channel_set, matrix in zip(plan.sets, figures.matrix_db, strict=True):
            names = [str(channel.index) for channel in channel_set]
            rows = [
                (name, *("" if k == name else f"{value:.1f}" for k, value in zip(names, row, strict=True)))
                for name, row in zip(names, matrix, strict=True)
            ]
            tables += [
                "dB by which an OFF taxel (row) is quieter than ON, at the tone of (column):",
                table(["", *names], rows),
            ]
    lines = [
        f"ON over OFF on one coil ({law}): {one_hot:.1f} dB with one channel on{formula}, {states:.1f} dB in its worst"
        f" state ({worst}: lowest channel first, 1 is ON); asked: {figures.asked_db:.1f} dB"
        f" (delta_y = {number(plan.spec.delta_y)})",
        *tables,
        f"with unequal pulls, other modes and stretching beams {kept:.1f} dB are left in the worst state{cost}"
        if kept is not None and kept < states - SHOWN_DB
        else "",
        "" if optimum is None else f"were all taxels of one mass, the best resonances would reach {optimum:.2f} dB",
        f"selectivity lost to the printer's resolution: {lost:.2f} dB" if lost >= SHOWN_DB else "",
    ]
    return [line for line in lines if line]


def _law_text(law: float) -> str:
    """Return in words how levels go with frequency under the law 1/f^`law`, as 'are equal' for 0.

    >>> _law_text(0.0), _law_text(1.0), _law_text(2.0)
    ('are equal', 'fall as 1/f', 'fall as 1/f^2')
    """
    if law == 0:
        return "are equal"
    return "fall as 1/f" if law == 1 else f"fall as 1/f^{law:g}"


SHOWN_DB = 0.05
SHOWN_BITS = 24
SHOWN_MATRIX = 4


def findings_text(findings: Iterable[Finding]) -> str:
    """Return findings as lines of text, the most severe first."""
    ordered = sorted(findings, key=lambda f: -LEVELS.index(f.level))
    return "\n".join(map(_finding_line, ordered)) or "all checks hold"


def _finding_line(f: Finding) -> str:
    return f"{f.level}: {f.where}: {f.message} [{f.code}]"


def outcome_line(done: str, findings: Iterable[Finding]) -> str:
    """Return a sentence that begins with `done` and ends with how the checks came out."""
    levels = [f.level for f in findings]
    errors, warnings = (levels.count(level) for level in ("error", "warning"))
    if errors:
        some = f"{errors} checks fail: see the errors" if errors > 1 else "a check fails: see the error"
        return f"{done}, but {some} below."
    if warnings:
        return f"{done}, with {warnings} warning{plural(warnings)}."
    return f"{done}, and every check holds."


def serious_text(findings: Iterable[Finding], verbose: bool = False) -> str:
    """Return errors and warnings as text, and the number of further findings; with `verbose` all findings.

    Warnings about parts of the prints' selectivity (`COUNTED_IN_PRINTS`) are only counted.
    """
    findings = tuple(findings)
    if verbose:
        return findings_text(findings)
    ordered = sorted(findings, key=lambda f: -LEVELS.index(f.level))
    serious = [f for f in ordered if f.level != "note"]
    # The verdict has the selectivity that prints keep, and all of these effects are part of it.
    parts = [f for f in serious if f.level == "warning" and f.code.startswith(COUNTED_IN_PRINTS)]
    lines = [_finding_line(f) for f in serious if f not in parts]
    more = (
        (len(parts), "more warning", " (of effects that are counted in the dB above)"),
        (len(ordered) - len(serious), "note", ""),
    )
    if counts := [f"{count} {word}{plural(count)}{about}" for count, word, about in more if count]:
        lines.append(f"--verbose shows {', '.join(counts)} and all details.")
    return "\n".join(lines)


COUNTED_IN_PRINTS = ("ladder.", "selectivity.", "coil.leak", "modes.")
"""Beginnings of the codes of findings whose effects are part of the selectivity that prints keep."""


def explanation_text(explanation: "Explanation") -> str:
    """Return the limits that bind, a table of changes and gains, and the most channels by scheme and level law."""
    keep = "channel of a coil would keep" if explanation.channels == 1 else "channels of a coil would keep"
    shares = ", ".join(f"{share:.1%} on channel {k}" for k, share in enumerate(explanation.channel_shares))
    stages = ", ".join(f"{stage} {n}" for stage, n in zip(STAGES, explanation.stage_channels, strict=True))
    lines = [
        f"on this grid of coils, printed perfectly, {explanation.channels} {keep} what was asked (drive:"
        f" {explanation.drive}); what stops one more:",
        *(f"  - {limit}" for limit in explanation.limits or ["nothing that was tried"]),
        f"share of prints in which a channel's re-tuned taxel keeps what was asked, untouched: {shares}",
        "so many channels per coil, spread over the whole band, would keep what was asked in prints, by what was"
        f" measured to re-tune them: {stages}",
    ]
    if explanation.changes:
        coils, channels = explanation.layout
        rows = [("as it is", "", f"{coils} x {channels}", *_printed_cells(explanation), "", "")]
        rows += [
            (
                change.change.replace(" with ", "\n  with ").replace(" without ", "\n  without "),
                change.cost.split()[-1],
                f"{change.coils} x {change.channels}",
                *_printed_cells(change),
                "" if change.gained_db is None else f"{change.gained_db:+z.1f}",
                f"{change.gained_in_band:+d}" if change.gained_in_band else "",
            )
            for change in explanation.changes
        ]
        lines += ["", "what padgen plan makes of the spec with one change:"]
        lines += [table(EXPLAINED, rows, left=2)]
        if any(change.change.startswith("delta_y") for change in explanation.changes):
            lines += ["Prints of a row are good if they keep what the row asks: a lower delta_y asks for less."]
    if explanation.movers:
        lines += [
            "",
            "the same pad with other washers, magnets and coils of the catalogue, layout and resonances chosen anew:",
        ]
        lines += [table(MOVERS_TOLD, [_mover_cells(row) for row in explanation.movers], left=2)]
    laws = list(dict.fromkeys(row.level_law for row in explanation.capacities))
    by_scheme: dict[str, list[str]] = {}
    for row in explanation.capacities:
        by_scheme.setdefault(row.scheme, []).append(f"{row.one_hot} / {_count_text(row.all_states, row.searched_to)}")
    columns = ["drive", *(law if isinstance(law, str) else _law_text(law).split()[-1] for law in laws)]
    heading = (
        "the largest number of channels on a coil that would keep what was asked, printed perfectly and with room for"
        " all (with one channel ON / in all on/off states); columns: how levels depend on frequency:"
    )
    return "\n".join([*lines, "", heading, table(columns, [(name, *cells) for name, cells in by_scheme.items()])])


EXPLAINED = (
    "change",
    "make\nanew",
    "coils x\nchannels\nof each",
    "good\nprints",
    "still\ngood\nlater",
    "prints\nkeep dB",
    "dB gained\nif prints\nwere perfect",
    "channels\nmore, were\nthere room",
)


MOVERS_TOLD = (
    "mover",
    "coil",
    "coils",
    "channels\na coil",
    "heat W",
    "peak V",
    "good\nprints",
    "prints\nkeep dB",
    "outputs",
)


def _mover_cells(row: "MoverRow") -> tuple[str, ...]:
    """Return the table row of a washer or magnet; the last column says 'no pad' if none can be planned with it."""
    if row.heat_w is None or row.peak_v is None:
        return row.mover, row.coil, "", "", "", "", "", "", "no pad"
    share = "" if row.good_share is None else f"{row.good_share:.0%}"
    kept = "" if row.print_db is None else f"{row.print_db:.1f}"
    heat = f"{row.heat_w:.2g}"
    return row.mover, row.coil, str(row.coils), str(row.channels), heat, f"{row.peak_v:.2g}", share, kept, row.outputs


def _printed_cells(of: "Explanation | Change") -> tuple[str, str, str]:
    share = "no pad" if of.good_share is None else f"{of.good_share:.0%}"
    for_life = "" if of.life_share is None else f"{of.life_share:.0%}"
    return share, for_life, "" if of.print_db is None else f"{of.print_db:.1f}"


def yield_text(result: "PrintYield") -> str:
    """Return tables of the yields before and after re-tuning, and of their gain without each kind of print error."""
    fewer = f"; {result.pads_asked} would have been too much work" if result.pads < result.pads_asked else ""
    columns = (
        "",
        "good taxels\n(95 % interval)",
        "good pads\n(95 % interval)",
        "ON over OFF,\n5 % below dB",
        "median\ndB",
        "5 %\nabove dB",
        "90 %\nreach dB",
    )
    rows = [
        (
            name,
            *(
                f"{100 * s.share:.2f} % ({100 * s.low:.2f} … {100 * s.high:.2f})"
                for s in (result_of.taxels, result_of.pads)
            ),
            *map(
                _decibels, (result_of.q05_db, result_of.median_db, result_of.q95_db, result_of.reached_by_90_percent_db)
            ),
        )
        for name, result_of in (("tones as planned", result.planned), ("re-tuned to each print", result.retuned))
    ]
    gains = (
        "without this error\nof prints",
        "its\nsigma",
        "more good\ntaxels, %",
        "more good\npads, %",
        "taxels,\nre-tuned, %",
        "pads,\nre-tuned, %",
        "median dB,\nre-tuned",
    )
    costs = [
        (
            _error_text(cost.spread),
            number(round(cost.sigma, 6)),
            *(f"{100 * gain:+z.1f}" for of in (cost.planned, cost.retuned) for gain in (of.taxels, of.pads)),
            _decibels(cost.retuned.median_db, "+"),
        )
        for cost in result.costs
    ]
    lines = [
        f"{result.pads} pads printed in the computer (seed {result.seed}): {result.criterion}{fewer}",
        "",
        table(columns, rows),
        "",
        table(gains, costs),
    ]
    costliest = (("with tones as planned", result.costliest_planned), ("re-tuned", result.costliest_retuned))
    lines += [
        f'{name}, the error "{_error_text(spread)}" costs the most {LOST[figure]}'
        for name, (spread, figure) in costliest
        if spread != "none"
    ]
    if result.nominal_db is not None and result.nominal_db < result.asked_db:
        lines.append(
            f"without any print errors a pad keeps {result.nominal_db:.1f} dB, so that hardly a pad can be good at"
            f" {result.asked_db:.1f} dB: read the dB columns, or ask for less (delta_y)"
        )
    return "\n".join(lines)


LOST = {"pads": "good pads", "taxels": "good taxels", "median_db": "dB of the median pad"}
"""Words for each figure that errors of prints lower."""
ERRORS = {
    "modulus": "stiffness of the plastic, whole print",
    "common_z_mm": "thickness, whole print, mm",
    "field_z_mm": "thickness over the bed, mm",
    "width_mm": "width, each taxel, mm",
    "thickness_mm": "thickness, each taxel, mm",
    "length_mm": "length, each taxel, mm",
    "glue_mg": "glue, each taxel, mg",
    "washer_mm": "place of the washer, each taxel, mm",
    "common_beads": "stiffness across strands, whole print",
    "across_beads": "stiffness across strands, every print",
    "beads": "stiffness across strands, each taxel",
    "common_gap_mm": "gap to the coils, whole pad, mm",
    "gap_mm": "gap to the coils, each taxel, mm",
    "common_glue_mg": "glue, whole pad, mg",
}
"""The errors of prints in words: the fields of `padgen.planner.printed_pads.Spreads`, with their units."""


def _error_text(spread: str) -> str:
    return ERRORS.get(spread, spread.replace("_", " "))


def _decibels(value: float | None, sign: str = "") -> str:
    return "" if value is None else f"{value:{sign}z.1f}"


def built_text(built: "Built", verbose: bool = False) -> str:
    """Return the verdict on the pad, how its build came out, its findings and figures, and the files."""
    state = "is up to date" if built.up_to_date else "is built"
    lines = [
        verdict_text(built.verdict),
        outcome_line(f"The pad {state}", built.findings),
        serious_text(built.findings, verbose),
        f"the pad: {figures_text(built.figures)}",
        *(f"{name}: {figures_text(figures)}" for name, figures in built.figures.get("parts", {}).items()),
        _settings_line(built.printing) if verbose else "",
        f"{'in' if built.up_to_date else 'written to'} {plain(str(built.folder))}: {', '.join(built.files)}",
    ]
    return "\n".join(line for line in lines if line)


def figures_text(figures: dict[str, Any]) -> str:
    """Return a mesh's measured figures (size, triangles, mass of plastic, smallest wall …) as one line."""
    parts = []
    absent: list[str] = []
    searched_mm = figures.get("searched_below_mm")
    advice = "" if "compared_with" in figures else " (--spec takes those of a spec)"
    if "size_mm" in figures:
        parts.append(" x ".join(number(v) for v in figures["size_mm"]) + " mm")
    for key, unit in (
        ("triangles", "triangles"),
        ("bodies", "body"),
        ("plastic_g", "g of plastic"),
        ("smallest_wall_mm", "mm smallest wall"),
        ("smallest_gap_mm", "mm smallest gap"),
        ("longest_bridge_mm", "mm longest bridge"),
        ("largest_difference_from_plan_mm", "mm largest difference from the plan"),
    ):
        value = figures.get(key)
        if value is not None:
            text = str(value) if isinstance(value, int) else f"{0.0 if abs(value) < 1e-6 else value:.3g}"
            parts.append(f"{text} {unit if value == 1 or key != 'bodies' else 'bodies'}")
        elif searched_mm and key.startswith("smallest_"):
            absent.append(key.removeprefix("smallest_").removesuffix("_mm"))
        if key == "smallest_gap_mm" and absent:
            parts.append(f"no {' or '.join(absent)} below {searched_mm:.3g} mm")
    for key, template in (
        ("part", "taken as the {}"),
        ("compared_with", "compared with {}"),
        ("limits_of", f"limits of printer {{}}{advice}"),
    ):
        if key in figures and (key, figures[key]) != ("part", "pad"):
            parts.append(template.format(figures[key]))
    return ", ".join(parts)


LEVEL_COLOURS = {"error": "#c2241a", "warning": "#a86a00", "note": "#666666"}
HEADINGS = ("channel", "resonance Hz", "drive Hz", "suspension", "beam mm (w × t × l)", "ring-up ms", "level µm peak")


def plan_html(plan: "Plan") -> str:
    """Return the plan as HTML: its verdict, one line on the pad, its figures, a table of channels, and the findings."""
    from html import escape

    from padgen.report.figures import figure_names, figures_of
    from padgen.report.inline_svg import svg

    rows = [
        (
            str(c.index),
            f"{c.resonance_hz:.2f}",
            f"{c.drive_hz:.2f}",
            c.beam.topology,
            f"{c.beam.width_mm:.3f} × {c.beam.thickness_mm:.2f} × {c.beam.length_mm:.2f}",
            f"{c.ring_up_ms:.0f}",
            f"{c.level_um:.2f}",
        )
        for c in plan.channels
    ]
    head = "".join(f"<th>{escape(heading)}</th>" for heading in HEADINGS)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    findings = "".join(
        f'<li style="color:{LEVEL_COLOURS[finding.level]}">{escape(findings_text([finding]))}</li>'
        for finding in plan.findings
    )
    verdict = "".join(f"<p>{escape(line)}</p>" for line in verdict_text(plan.verdict).split("\n"))
    channels = f"<table><tr>{head}</tr>{body}</table>"
    figures = "".join(svg(figures_of(plan, name, "notebook", quick=True)[0]) for name in figure_names("notebook"))
    return f"{verdict}<p>{escape(repr(plan))}</p>{figures}{channels}<ul>{findings}</ul>"
