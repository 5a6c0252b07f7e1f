// The pad in 3-D: each distinct mesh once, placed many times; taxels that can be picked, coloured, cut and moved.

import {
  AmbientLight,
  BackSide,
  BufferAttribute,
  BufferGeometry,
  Color,
  DecrementWrapStencilOp,
  DirectionalLight,
  FrontSide,
  Group,
  HemisphereLight,
  IncrementWrapStencilOp,
  InstancedBufferAttribute,
  InstancedMesh,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  NotEqualStencilFunc,
  PerspectiveCamera,
  Plane,
  PlaneGeometry,
  Raycaster,
  Scene,
  TorusGeometry,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { decoded } from "./dom.js";

const MATERIALS = { pad: "#d9d5cb", steel: "#8d949e", ballast: "#a39a72", copper: "#b8753a", iron: "#4a4e55", tray: "#b9c0c9", board: "#4f7d5c", guard: "#c9d8c5" };
// How far parts move apart, over the pad's thickness: the pad up, washers, coils and tray down.
const APART = { pad: 3.2, steel: 1.2, ballast: 2.2, copper: -1.2, iron: -1.2, tray: -6, board: -1.2, guard: 5 };
// Directions to look from, azimuth and elevation in degrees, and how much of a ball around the pad is to be seen.
const LOOKS = { aslant: [-35, 38, 0.88], top: [0, 89.9, 0.8], below: [-35, -40, 0.88], side: [0, 2, 0.8] };
const MARKS = 256;

// Neighbours overlap by half a thousandth, so that no rounding leaves cracks between them.
const OVERLAP = 1.0005;

function geometryOf(shape) {
  const steps = new Int16Array(decoded(shape.vertices));
  const index = shape.wide ? new Uint32Array(decoded(shape.triangles)) : new Uint16Array(decoded(shape.triangles));
  const count = steps.length / 4;
  const [places, heights] = [new Float32Array(3 * count), new Float32Array(count)];
  for (let k = 0; k < count; k++) {
    for (let i = 0; i < 3; i++) places[3 * k + i] = (steps[4 * k + i] * shape.step_mm + shape.middle_mm[i]) * (i < 2 ? OVERLAP : 1);
    heights[k] = steps[4 * k + 3] * shape.height_step;
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(places, 3));
  geometry.setAttribute("height", new BufferAttribute(heights, 1));
  geometry.setIndex(new BufferAttribute(index, 1));
  return geometry;
}

export function makeView(canvas, { picked, drawn }) {
  const renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, stencil: true, preserveDrawingBuffer: true });
  renderer.localClippingEnabled = true;
  const scene = new Scene();
  const camera = new PerspectiveCamera(28, 1, 0.1, 5000);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  // A finger or wheel that only passes over the view scrolls the page; once the view is chosen they zoom.
  canvas.style.touchAction = "pan-y";
  controls.enableZoom = false;
  canvas.addEventListener("focus", () => (controls.enableZoom = true));
  canvas.addEventListener("blur", () => (controls.enableZoom = false));
  controls.addEventListener("change", () => draw());
  const sun = new DirectionalLight("#ffffff", 2.1);
  scene.add(new HemisphereLight("#ffffff", "#8a8f99", 1.25), new AmbientLight("#ffffff", 0.25), sun);

  const plane = new Plane(new Vector3(0, 1, 0), 1e9);
  const marks = new InstancedMesh(new TorusGeometry(1, 0.09, 10, 40), new MeshBasicMaterial({ color: "#e4572e" }), MARKS);
  marks.count = 0;
  marks.frustumCulled = false;
  const root = new Group();
  scene.add(root, marks);

  let data = null;
  let layers = []; // {shape, mesh, sides, taxels}
  let ofChannel = new Map(); // channel → [layers], taxel and washer, whose places are those of its taxels
  let apart = 0;
  let radius = 50;
  let bottom = 0; // of coils or tray, mm
  let asked = false;

  // Materials are made once: compiling their shaders takes longer than all else that a new plan needs.
  const materials = new Map();
  function material(use, Kind, name, options) {
    const key = `${use} ${name}`;
    if (!materials.has(key)) materials.set(key, Object.assign(new Kind({ color: MATERIALS[name], ...options }), { onBeforeCompile: moved }));
    return materials.get(key);
  }

  // Parts move by their height in the mode, times their copy's lift; what does not move keeps the plastic's colour.
  function moved(shader) {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute float height;\nattribute float lift;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\ntransformed.z += height * lift;")
      .replace("#include <color_vertex>", "#include <color_vertex>\n#ifdef USE_INSTANCING_COLOR\nvColor.rgb = mix(vec3(1.0), vColor.rgb, smoothstep(0.0, 0.1, abs(height)));\n#endif");
  }

  // Where the cut is inside a material, more of its back faces than of its front faces lie behind the plane: the stencil
  // counts them, and a lid in the plane is drawn where it is not 0.
  const COUNTS = [[BackSide, IncrementWrapStencilOp], [FrontSide, DecrementWrapStencilOp]].map(([side, op]) => ({
    ...{ side, clippingPlanes: [plane], colorWrite: false, depthWrite: false, depthTest: false },
    ...{ stencilWrite: true, stencilZPass: op },
  }));
  const lids = Object.keys(MATERIALS).map((name, k) => {
    const own = material("lid", MeshBasicMaterial, name, { stencilWrite: true, stencilFunc: NotEqualStencilFunc });
    own.color.multiplyScalar(0.4);
    const lid = new Mesh(new PlaneGeometry(1, 1).rotateX(Math.PI / 2), own);
    lid.renderOrder = 2 * k + 2;
    lid.visible = false;
    lid.onAfterRender = () => renderer.clearStencil();
    scene.add(lid);
    return lid;
  });

  function layerOf(shape) {
    const moves = shape.channel !== null;
    const count = shape.places.length;
    const geometry = geometryOf(shape);
    if (moves) geometry.setAttribute("lift", new InstancedBufferAttribute(new Float32Array(count), 1));
    const mesh = new InstancedMesh(geometry, material("lit", MeshLambertMaterial, shape.material, { flatShading: true }), count);
    mesh.frustumCulled = false;
    const sides = COUNTS.map((options, k) => {
      const side = new InstancedMesh(geometry, material(k, MeshBasicMaterial, shape.material, options), count);
      side.instanceMatrix = mesh.instanceMatrix;
      side.frustumCulled = false;
      side.renderOrder = 2 * Object.keys(MATERIALS).indexOf(shape.material) + 1;
      return side;
    });
    return { shape, mesh, sides };
  }

  const MESH = ["name", "material", "channel", "step_mm", "vertices", "triangles"];
  const alike = (one, other) => MESH.every((key) => one[key] === other[key]) && `${one.middle_mm}` === `${other.middle_mm}` && one.places.length === other.places.length;

  function show(next) {
    data = next;
    const before = layers;
    root.clear();
    ofChannel = new Map();
    const matrix = new Matrix4();
    // Parts whose mesh is as before stay on the graphics card.
    layers = data.shapes.map((shape) => {
      const layer = before.find((own) => alike(own.shape, shape)) ?? layerOf(shape);
      layer.shape = shape;
      layer.taxels = shape.names.length ? shape.names.map((name) => data.index.get(name)) : null;
      shape.places.forEach(([x, y, z, turned], k) => layer.mesh.setMatrixAt(k, matrix.makeRotationZ(turned ? Math.PI : 0).setPosition(x, y, z)));
      layer.mesh.instanceMatrix.needsUpdate = true;
      layer.mesh.computeBoundingSphere();
      if (shape.channel !== null) ofChannel.set(shape.channel, [...(ofChannel.get(shape.channel) ?? []), layer]);
      root.add(layer.mesh, ...layer.sides);
      return layer;
    });
    for (const { mesh } of before.filter((layer) => !layers.includes(layer))) (mesh.geometry.dispose(), mesh.dispose());
    const { pad } = data;
    radius = Math.hypot(pad.width_mm / 2 + pad.border_mm, pad.depth_mm / 2 + pad.border_mm);
    bottom = Math.min(...data.shapes.map((shape) => shape.middle_mm[2] - (shape.material === "pad" ? 0 : shape.depth_mm / 2)));
    section(cutAt);
    explode(apart);
  }

  // Place of each taxel in its channel's meshes, in the order of the taxels.
  function eachTaxel(does) {
    const next = new Map();
    data.taxels.channel.forEach((channel, index) => {
      const k = next.get(channel) || 0;
      next.set(channel, k + 1);
      does(index, ofChannel.get(channel), k);
    });
  }

  function colours(of) {
    const base = new Color(MATERIALS.pad);
    const colour = new Color();
    eachTaxel((index, [taxel], k) => {
      colour.set(of(index));
      // The mesh multiplies by the plastic's colour, which is divided out so that legends hold.
      colour.setRGB(colour.r / base.r, colour.g / base.g, colour.b / base.b);
      taxel.mesh.setColorAt(k, colour);
    });
    for (const [taxel] of ofChannel.values()) taxel.mesh.instanceColor.needsUpdate = true;
    draw();
  }

  /** Move taxels up by so many mm each (an array in their order). */
  function lift(heights) {
    eachTaxel((index, own, k) => own.forEach(({ mesh }) => (mesh.geometry.attributes.lift.array[k] = heights[index])));
    for (const own of ofChannel.values()) for (const { mesh } of own) mesh.geometry.attributes.lift.needsUpdate = true;
    draw();
  }

  let hidden = [];
  /** Hide the parts of these materials. */
  function hide(materials) {
    hidden = materials;
    const shown = (name) => !hidden.includes(name);
    for (const { shape, mesh, sides } of layers) {
      mesh.visible = shown(shape.material);
      for (const side of sides) side.visible = mesh.visible && cutAt > 0;
    }
    lids.forEach((lid, k) => (lid.visible = cutAt > 0 && shown(Object.keys(MATERIALS)[k])));
    draw();
  }

  const zOf = (name) => apart * APART[name] * data.pad.frame_mm;

  function explode(share) {
    apart = share;
    for (const { shape, mesh, sides } of layers) for (const each of [mesh, ...sides]) each.position.z = zOf(shape.material);
    mark(marked);
  }

  let cutAt = 0;
  /** Cut away what lies nearer than a share of the depth; 0: nothing. */
  function section(share) {
    const half = data.pad.depth_mm / 2 + data.pad.border_mm;
    if (share > 0 !== cutAt > 0)
      for (const own of materials.values()) {
        if (own.isMeshLambertMaterial) own.clippingPlanes = share > 0 ? [plane] : null;
      }
    cutAt = share;
    plane.constant = share > 0 ? half - 2 * half * share + 1e-3 : 1e9;
    for (const lid of lids) {
      lid.position.y = -plane.constant;
      lid.scale.setScalar(20 * radius);
    }
    hide(hidden);
  }

  let marked = [];
  /** Ring places [x, y] in mm; the first is the chosen taxel. */
  function mark(places) {
    marked = places.slice(0, MARKS);
    const size = Math.max(0.78 * data.pad.boss_diameter_mm, 0.014 * radius);
    const z = data.pad.boss_top_mm + zOf("pad") + 0.02 * data.pad.frame_mm;
    marks.count = marked.length;
    marked.forEach(([x, y], k) => marks.setMatrixAt(k, new Matrix4().makeScale(size, size, size).setPosition(x, y, z)));
    marks.instanceMatrix.needsUpdate = true;
    draw();
  }

  function look(name) {
    const [azimuth, elevation] = LOOKS[name].slice(0, 2).map((degrees) => (degrees * Math.PI) / 180);
    lookAlong(new Vector3(Math.sin(azimuth) * Math.cos(elevation), -Math.cos(azimuth) * Math.cos(elevation), Math.sin(elevation)), LOOKS[name][2]);
  }

  /** Show all parts whole, from where the camera is. */
  const fit = () => lookAlong(camera.position.clone().sub(controls.target).normalize(), 1);

  /** Look at all parts against the direction `ahead`; `share` is how much of a ball around them is to be seen. */
  function lookAlong(ahead, share) {
    const [top, low] = [data.pad.boss_top_mm + zOf("pad"), hidden.includes("tray") ? zOf("steel") : bottom + zOf("tray")];
    // A board reaches beyond the pad, to its connectors.
    const board = hidden.includes("board") ? null : layers.find(({ shape }) => shape.material === "board")?.mesh.boundingSphere;
    const around = Math.hypot(Math.max(radius, board?.radius ?? 0), (top - low) / 2);
    const far = (share * (camera.aspect < 1.3 ? 1.1 : 1) * around) / Math.sin((camera.fov * Math.PI) / 360) / Math.min(1, camera.aspect);
    controls.target.set(0, board?.center.y ?? 0, (top + low) / 2);
    camera.position.copy(controls.target).addScaledVector(ahead, far);
    camera.near = far / 50;
    camera.far = far * 10;
    controls.minDistance = radius / 8;
    controls.maxDistance = far * 4;
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }

  function zoom(factor) {
    camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    controls.update();
    draw();
  }

  let size = "";
  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    if (!width || !height || size === `${width} ${height} ${ratio}`) return;
    size = `${width} ${height} ${ratio}`;
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    // A new size clears the picture, which is drawn before the browser shows that.
    if (canvas.dataset.drawn) drawNow();
  }

  function drawNow() {
    asked = false;
    if (!data) return;
    // The light stands by the viewer's left shoulder.
    sun.position.copy(camera.position).sub(controls.target).normalize().applyAxisAngle(camera.up, -0.6).add(new Vector3(0, 0, 0.7 * Math.sign(camera.position.z || 1)));
    renderer.render(scene, camera);
    canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
    drawn();
  }

  /** Return a place (mm) in the canvas: x, y in CSS pixels from its corner. */
  function onCanvas(x, y, z) {
    const at = new Vector3(x, y, z).project(camera);
    return [((at.x + 1) / 2) * canvas.clientWidth, ((1 - at.y) / 2) * canvas.clientHeight];
  }

  /** Return what the cut goes through as [name, x, y] in CSS pixels of the canvas: the parts of the taxel nearest to it. */
  function cutParts() {
    if (!data || cutAt <= 0) return [];
    const { pad, taxels, coils } = data;
    const y = -plane.constant;
    const nearest = (places) => places.reduce((best, at) => (Math.abs(at[1] - y) < Math.abs(best[1] - y) ? at : best));
    const parts = [];
    const name = (label, material, x, z) => hidden.includes(material) || parts.push([label, ...onCanvas(x, y, z + zOf(material))]);
    const side = -(pad.width_mm + pad.border_mm) / 2;
    name("frame", "pad", side, pad.frame_mm / 2);
    // Half the width of a disc of this diameter where the cut goes through it, 0 beside it.
    const half = (diameter, off) => Math.sqrt(Math.max((diameter / 2) ** 2 - off ** 2, 0));
    const [x, taxelY] = nearest(taxels.x_mm.map((at, k) => [at, taxels.y_mm[k]]));
    const [outer, , thickness] = pad.washer_mm;
    if (half(pad.boss_diameter_mm, taxelY - y)) name("boss", "pad", x, pad.boss_top_mm);
    const washer = half(outer, taxelY - y);
    if (washer) name("washer", "steel", x + 0.9 * washer, pad.washer_underside_mm + thickness / 2);
    const [coilX, coilY] = nearest(coils.places);
    const coil = half(pad.coil_mm[0], coilY - y);
    if (coil) name("coil", "copper", coilX + 0.9 * coil, pad.washer_underside_mm - pad.gap_mm - pad.coil_mm[1] / 2);
    const has = (material) => layers.some(({ shape }) => shape.material === material);
    if (has("tray")) name("tray", "tray", side, bottom + 1);
    if (has("board")) name("board", "board", side, pad.washer_underside_mm - pad.gap_mm - pad.coil_mm[1] / 2);
    return parts;
  }

  function draw() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => asked && drawNow());
  }

  /** Return the place of a point (mm) in the page: x, y in CSS pixels. */
  function placeOf(x, y, z) {
    const at = new Vector3(x, y, z + zOf("pad")).project(camera);
    const box = canvas.getBoundingClientRect();
    return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
  }

  const ray = new Raycaster();
  function taxelAt(event) {
    const box = canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    ray.setFromCamera(at, camera);
    const hits = ray.intersectObjects(layers.map(({ mesh }) => mesh).filter((mesh) => mesh.visible), false).filter(({ point }) => plane.distanceToPoint(point) >= 0);
    if (!hits.length) return null;
    const layer = layers.find(({ mesh }) => mesh === hits[0].object);
    return layer.taxels ? layer.taxels[hits[0].instanceId] : null;
  }

  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  canvas.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) picked(taxelAt(event));
    pressed = null;
  });

  /** Return a picture of the pad as a PNG's data address, looked at and taken apart as asked; the view stays. */
  function picture(name, share, width, height, without) {
    const kept = { apart, hidden, position: camera.position.clone(), target: controls.target.clone(), aspect: camera.aspect, ratio: renderer.getPixelRatio(), size: renderer.getSize(new Vector2()), count: marks.count };
    marks.count = 0;
    hide(without);
    renderer.setPixelRatio(1);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    explode(share);
    look(name);
    drawNow();
    const taken = canvas.toDataURL("image/png");
    hide(kept.hidden);
    renderer.setPixelRatio(kept.ratio);
    renderer.setSize(kept.size.x, kept.size.y, false);
    camera.aspect = kept.aspect;
    camera.position.copy(kept.position);
    controls.target.copy(kept.target);
    explode(kept.apart);
    marks.count = kept.count;
    camera.updateProjectionMatrix();
    controls.update();
    drawNow();
    return taken;
  }

  new ResizeObserver(resize).observe(canvas.parentElement);
  return { cutParts, fit, show, shows: (those) => Boolean(data) && (!those || data === those), colours, lift, hide, explode, section, mark, look, zoom, resize, placeOf, picture, drawNow };
}
