// What moves the taxels: lines of the squared current, and each taxel's modes.
//
// A coil pulls with i². Each ON channel makes its wanted line, two together make sums and differences, with a constant
// current also second harmonics (padgen/physics/selectivity.py). A taxel answers a line f with the sum of its modes
// g / (1 − (f/f_k)² + j f/(f_k Q)); gains are over its amplitude under its own line at its own resonance.

const QUARTER = Math.PI / 2;
// Phases of the wanted lines, of sums, differences and harmonics, as the squares of sums of sines or roots have them.
const PHASES = {
  tones: { wanted: Math.PI, sum: Math.PI, difference: 0, harmonic: 0 },
  biased: { wanted: -QUARTER, sum: Math.PI, difference: 0, harmonic: Math.PI },
  root: { wanted: 0, sum: 0, difference: 0, harmonic: 0 },
};

/** Return the lines {hz, size, phase, kind, of} of one coil whose channels `on` (positions in its set) play. */
export function linesOf(data, which, on) {
  const { motion, channels } = data;
  const set = motion.sets[which];
  const hz = (i) => channels[set.channels[i]].resonance_hz;
  const phase = PHASES[motion.current] || PHASES.tones;
  const lines = on.map((i) => ({ hz: hz(i), size: set.line[i], phase: phase.wanted, kind: "tone", of: [i] }));
  if (!set.pairs.length) return lines;
  for (const i of motion.current === "biased" ? on : [])
    lines.push({ hz: 2 * hz(i), size: set.pairs[i][i] / 2, phase: phase.harmonic, kind: "harmonic", of: [i] });
  for (let a = 0; a < on.length; a++)
    for (let b = a + 1; b < on.length; b++) {
      const [i, j] = [on[a], on[b]];
      const size = set.pairs[i][j];
      lines.push({ hz: (hz(i) + hz(j)) * motion.pair_scale, size, phase: phase.sum, kind: "sum", of: [i, j] });
      lines.push({ hz: Math.abs(hz(i) - hz(j)) * motion.pair_scale, size, phase: phase.difference, kind: "difference", of: [i, j] });
    }
  return lines;
}

/** Return the response of taxel i of a set to a line at f: three complex parts (up, tilting about x and y), over its own ON. */
export function response(data, which, i, f) {
  const set = data.motion.sets[which];
  const q = data.channels[set.channels[i]].q;
  const parts = [0, 0, 0, 0, 0, 0];
  set.modes_hz[i].forEach((mode, k) => {
    const share = f / mode;
    const real = (1 - share) * (1 + share);
    const imaginary = share / q;
    const square = real * real + imaginary * imaginary;
    for (let p = 0; p < 3; p++) {
      const gain = set.gains[i][k][p];
      parts[2 * p] += (gain * real) / square;
      parts[2 * p + 1] -= (gain * imaginary) / square;
    }
  });
  return parts;
}

export const felt = (parts) => Math.hypot(...parts);

/**
 * Return what each taxel of a coil does in a state: its felt level in µm, and its vertical motion as tones
 * {hz, size in µm, phase}. Lines of distinct frequency add as energies; where channels take turns, the loudest counts.
 */
export function movedBy(data, which, on) {
  const set = data.motion.sets[which];
  const lines = linesOf(data, which, on);
  return set.channels.map((channel, i) => {
    const level = data.channels[channel].level_um;
    let energy = 0;
    const tones = lines.map((line) => {
      const parts = response(data, which, i, line.hz);
      const over = line.size / set.line[i];
      const own = (felt(parts) * over) ** 2;
      energy = data.motion.turns ? Math.max(energy, own) : energy + own;
      const [real, imaginary] = parts;
      return { hz: line.hz, size: level * over * Math.hypot(real, imaginary), phase: line.phase + Math.atan2(imaginary, real), of: line.of };
    });
    return { level_um: level * Math.sqrt(energy), tones };
  });
}

/** Return the vertical displacement in µm at a time in s of a motion's tones. */
export function at(tones, seconds) {
  let z = 0;
  for (const tone of tones) z += tone.size * Math.cos(2 * Math.PI * tone.hz * seconds + tone.phase);
  return z;
}

/** Return frames of a sequence: for each frame, the set of taxels that are on, by index. */
export function framesOf(data, sequence) {
  const { taxels } = data;
  const every = taxels.id.map((_, index) => index);
  const by = (key) => {
    const groups = new Map();
    for (const index of every) {
      const name = key(index);
      if (!groups.has(name)) groups.set(name, new Set());
      groups.get(name).add(index);
    }
    return [...groups.entries()].sort(([a], [b]) => a - b).map(([, group]) => group);
  };
  if (sequence === "each") return every.map((index) => new Set([index]));
  if (sequence === "rows") return by((index) => taxels.pixel[index][0]);
  if (sequence === "columns") return by((index) => taxels.pixel[index][1]);
  return by((index) => (taxels.pixel[index][0] + taxels.pixel[index][1]) % 2);
}
