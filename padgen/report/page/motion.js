// What moves in a state: sums of what padgen found of each line of the squared current (padgen/report/motion.py).

import { numbers } from "./dom.js";

const unpacked = new WeakMap();

function figuresOf(set) {
  if (!unpacked.has(set)) unpacked.set(set, { energy: numbers(set.energy), moved: numbers(set.moved_um) });
  return unpacked.get(set);
}

/**
 * Return what each taxel of a coil does while the channels `on`, by their positions in the set, play: its felt level in
 * µm, and its vertical motion as tones {hz, real, imaginary} in µm. Energies add; where channels take turns, the loudest
 * counts.
 */
export function movedBy(data, which, on) {
  const set = data.motion.sets[which];
  const { energy, moved } = figuresOf(set);
  const playing = new Set(on);
  const count = set.hz.length;
  const lines = set.hz.map((_, line) => line).filter((line) => set.makers[line].every((maker) => playing.has(maker)));
  return set.channels.map((channel, i) => {
    const energies = lines.map((line) => energy[i * count + line]);
    const whole = data.motion.turns ? Math.max(0, ...energies) : energies.reduce((sum, each) => sum + each, 0);
    const tones = lines.map((line) => ({ hz: set.hz[line], real: moved[2 * (i * count + line)], imaginary: moved[2 * (i * count + line) + 1] }));
    return { level_um: data.channels[channel].level_um * Math.sqrt(whole), tones };
  });
}

/** Return the vertical displacement in µm at a time in s of a motion's tones. */
export function at(tones, seconds) {
  let z = 0;
  for (const tone of tones) {
    const turned = 2 * Math.PI * tone.hz * seconds;
    z += tone.real * Math.cos(turned) - tone.imaginary * Math.sin(turned);
  }
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
