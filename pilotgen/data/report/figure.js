// The pilot in space: bones and muscles between the node poses of his deck, moved by their own modes. World axes:
// x forward, y up, z right [m].
"use strict";

pilotgen.figure = (() => {
  const { text, look, state, model } = pilotgen;
  const BONE = 0xe8dcc0, SKIN = 0xc9a58c, SUIT = 0x5f7f9f, METAL = 0x3c4148, CUSHION = 0x8b9096, GHOST = 0x9aa4ae;
  // bones of an arm: from, to, radius [m]
  const ARM = [["shoulder", "elbow", 0.018], ["elbow", "ulnar_head", 0.012], ["elbow_radius", "wrist", 0.011], ["wrist", "grip", 0.016]];
  const BONE_NAMES = ["humerus", "ulna", "radius", "hand"];
  const JOINTS_OF = { humerus: "shoulder", ulna: "elbow", radius: "forearm", hand: "wrist" };
  const VIEWS = { front: [[1, 0.05, 0], "front"], side: [[0, 0.05, -1], "side"], top: [[0.001, 1, 0], "top"], reset: [[0.85, 0.35, -0.85], "oblique"] };

  let scene, camera, renderer, controls, host, structure, world;
  let chosen = null, nominal = null; // puppets
  const settings = { motion: "none", shape: 0, gain: 30, playing: false, nominal: "beside" };
  let clock = 0, last = 0, frame = 0;

  const stored = () => Object.keys(model.data.skeletons.each).map(Number);
  const known = new Map();

  function skeleton(pilot) {
    structure = model.data.skeletons.structure;
    if (!known.has(pilot)) {
      const packed = model.data.skeletons.each[pilot];
      const all = pilotgen.decode.floats(packed.places);
      const n = structure.nodes.length, p = structure.points.length, q = structure.muscles.length;
      const triples = (from, count) => Array.from({ length: count }, (_, k) => Array.from(all.subarray(from + 3 * k, from + 3 * k + 3)));
      known.set(pilot, {
        pilot, nodes: triples(0, n), points: triples(3 * n, p), muscles: triples(3 * (n + p), 2 * q),
        activation: pilotgen.decode.floats(packed.activation), joints: packed.joints, sizes: packed.sizes,
        // per shape: real parts of every node's six numbers, then imaginary parts
        shapes: packed.shapes.split("|").map((levels, k) => Float64Array.from(pilotgen.decode.levels(levels), (v) => v * packed.steps[k])),
      });
    }
    return known.get(pilot);
  }

  // ---- motion: what every node does at an instant, relative to the seat, and the seat itself

  function hz() {
    if (settings.motion === "response") return structure.shapes_hz[settings.shape - 1];
    const pilot = chosen ? chosen.body.pilot : null;
    return pilot === null ? 1 : model.value("pilot_frequency_hz", pilot) || 1;
  }

  function motion(body, phase) {
    const n = structure.nodes.length;
    const found = { nodes: new Float64Array(6 * n), seat: [0, 0, 0] };
    if (settings.motion === "none") return found;
    const shape = body.shapes[settings.motion === "mode" ? 0 : settings.shape];
    const scale = settings.motion === "mode" ? settings.gain * 1e-3 : settings.gain;
    const [c, s] = [Math.cos(phase), Math.sin(phase)];
    for (let k = 0; k < 6 * n; k += 1) found.nodes[k] = scale * (shape[k] * c - shape[6 * n + k] * s);
    // the seat's own motion under 1 m/s^2: -cos / w^2
    if (settings.motion === "response") found.seat[structure.axis] = -scale * c / (2 * Math.PI * hz()) ** 2;
    return found;
  }

  function moved(place, node, body, now) {
    const k = 6 * node;
    const [x, y, z] = body.nodes[node];
    const [rx, ry, rz] = [place[0] - x, place[1] - y, place[2] - z];
    const [gx, gy, gz] = now.nodes.subarray(k + 3, k + 6);
    return [
      place[0] + now.seat[0] + now.nodes[k] + gy * rz - gz * ry,
      place[1] + now.seat[1] + now.nodes[k + 1] + gz * rx - gx * rz,
      place[2] + now.seat[2] + now.nodes[k + 2] + gx * ry - gy * rx,
    ];
  }

  // ---- one drawn pilot

  const UP = () => new THREE.Vector3(0, 1, 0);
  const vector = (p) => new THREE.Vector3(p[0], p[1], p[2]);

  function puppet(ghost) {
    const group = new THREE.Group();
    world.add(group);
    const material = (colour, opacity = 1) => new THREE.MeshStandardMaterial({
      color: ghost ? GHOST : colour, roughness: 0.75, metalness: 0.05,
      transparent: ghost || opacity < 1, opacity: ghost ? Math.min(0.45, opacity) : opacity, depthWrite: !ghost && opacity === 1,
    });
    const parts = [];
    const shades = { bone: material(BONE), skin: material(SKIN, 0.95), suit: material(SUIT, 0.38), metal: material(METAL), seat: material(CUSHION), leg: material(SUIT, 0.3) };
    const rod = new THREE.CylinderGeometry(1, 1, 1, 20), ball = new THREE.SphereGeometry(1, 28, 20), box = new THREE.BoxGeometry(1, 1, 1);

    // a rod between two places with round ends; place functions take (body, now)
    function link(from, to, radius, shade, about = null) {
      const mesh = new THREE.Mesh(rod, shade), ends = [new THREE.Mesh(ball, shade), new THREE.Mesh(ball, shade)];
      for (const one of [mesh, ...ends]) { one.userData.about = about; group.add(one); }
      ends.forEach((end) => end.scale.setScalar(radius));
      parts.push((body, now) => {
        const [a, b] = [vector(from(body, now)), vector(to(body, now))];
        ends[0].position.copy(a);
        ends[1].position.copy(b);
        const along = b.clone().sub(a);
        const length = along.length() || 1e-6;
        mesh.position.copy(a).addScaledVector(along, 0.5);
        mesh.quaternion.setFromUnitVectors(UP(), along.divideScalar(length));
        mesh.scale.set(radius, length, radius);
      });
    }
    function blob(centre, toward, size, shade, about = null) {
      const mesh = new THREE.Mesh(ball, shade);
      mesh.userData.about = about;
      mesh.scale.set(...size);
      group.add(mesh);
      parts.push((body, now) => {
        const c = vector(centre(body, now));
        mesh.position.copy(c);
        const [from, to] = toward(body, now).map(vector);
        mesh.quaternion.setFromUnitVectors(UP(), to.sub(from).normalize());
      });
    }

    const index = (name) => structure.points.indexOf(name);
    const has = (name) => index(name) >= 0;
    const at = (name) => (body, now) => moved(body.points[index(name)], structure.carriers[index(name)], body, now);
    const between = (a, b, share) => (body, now) => {
      const [p, q] = [at(a)(body, now), at(b)(body, now)];
      return p.map((v, k) => v + share * (q[k] - v));
    };
    const shifted = (name, by) => (body, now) => at(name)(body, now).map((v, k) => v + by(body)[k]);

    // torso and head
    const spine = (body, now) => [at("hip")(body, now), at("neck_t1")(body, now)];
    blob(at("hip"), spine, [0.105, 0.09, 0.155], shades.suit, "pelvis");
    blob(between("hip", "thorax", 0.5), spine, [0.1, 0.15, 0.13], shades.suit, "abdomen");
    blob(between("thorax", "neck_t1", 0.12), spine, [0.115, 0.2, 0.165], shades.suit, "thorax");
    link(at("hip"), at("lumbar_l3"), 0.022, shades.bone, "lumbar spine");
    link(at("lumbar_l3"), at("neck_t1"), 0.02, shades.bone, "thoracic spine");
    link(at("neck_t1"), at("head"), 0.028, shades.skin, "neck");
    for (const side of ["l", "r"]) link(at("neck_t1"), at(`glenohumeral_${side}`), 0.012, shades.bone, "shoulder girdle");
    blob(at("head"), (body, now) => [at("neck_t1")(body, now), at("head")(body, now)], [0.095, 0.118, 0.078], shades.skin, "head");
    blob(shifted("head", () => [0.095, -0.012, 0]), () => [[0, 0, 0], [0.3, 1, 0]], [0.014, 0.024, 0.011], shades.skin, "head");
    // arms
    for (const side of ["l", "r"]) {
      if (!has(`elbow_${side}`)) continue;
      ARM.forEach(([from, to, radius], k) => link(at(`${from}_${side}`), at(`${to}_${side}`), radius, shades.bone, `${BONE_NAMES[k]}_${side}`));
      blob(at(`grip_${side}`), (body, now) => [at(`wrist_${side}`)(body, now), at(`grip_${side}`)(body, now)], [0.03, 0.05, 0.04], shades.skin, `hand_${side}`);
    }
    // controls
    for (const control of ["lever", "stick"]) {
      if (!has(`${control}_grip`)) continue;
      link(at(`${control}_hinge`), at(`${control}_grip`), 0.013, shades.metal, control === "lever" ? "collective lever" : "cyclic stick");
      blob(at(`${control}_hinge`), () => [[0, 0, 0], [0, 1, 0]], [0.028, 0.028, 0.028], shades.metal, "hinge");
      link(between(`${control}_hinge`, `${control}_grip`, 0.84), between(`${control}_hinge`, `${control}_grip`, 1.1), 0.021, shades.metal, "grip");
    }
    // seat: pan and back, and legs for the eye; neither is a body of the deck
    const seatNode = structure.nodes.indexOf("seat");
    const still = (place, body, now) => moved(place, seatNode, body, now);
    function board(size, centre, tilt) {
      const mesh = new THREE.Mesh(box, shades.seat);
      mesh.scale.set(...size);
      group.add(mesh);
      parts.push((body, now) => {
        mesh.position.copy(vector(still(centre(body), body, now)));
        mesh.rotation.z = tilt(body);
      });
    }
    const lean = (body) => body.sizes.back_angle_deg * Math.PI / 180;
    const reference = (body) => body.sizes.seat_m;
    const onBack = (body, forward, up) => {
      const [c, s] = [Math.cos(lean(body)), Math.sin(lean(body))], [x, y] = reference(body);
      return [x + forward * c - up * s, y + up * c + forward * s, 0];
    };
    board([0.46, 0.05, 0.44], (body) => { const [x, y] = reference(body); return [x + 0.2, y + 0.01, 0]; }, () => 0.06);
    board([0.05, 0.66, 0.42], (body) => onBack(body, -0.035, 0.34), lean);
    if (!ghost) {
      for (const z of [-1, 1]) {
        const hip = (body, now) => still([body.points[index("hip")][0], body.points[index("hip")][1] - 0.01, z * 0.24 * body.sizes.hip_breadth_m], body, now);
        const knee = (body, now) => { const p = body.points[index("hip")], t = 0.245 * body.sizes.stature_m; return still([p[0] + 0.97 * t, p[1] + 0.2 * t, z * 0.16], body, now); };
        const ankle = (body, now) => { const p = body.points[index("hip")], t = body.sizes.stature_m; return still([p[0] + 0.97 * 0.245 * t + 0.42 * 0.246 * t, p[1] + 0.2 * 0.245 * t - 0.9 * 0.246 * t, z * 0.14], body, now); };
        const toe = (body, now) => ankle(body, now).map((v, k) => v + [0.17, 0.05, 0][k]);
        link(hip, knee, 0.06, shades.leg, "leg: no part of the model");
        link(knee, ankle, 0.045, shades.leg, "leg: no part of the model");
        link(ankle, toe, 0.035, shades.leg, "leg: no part of the model");
      }
    }
    // muscles, coloured by activation
    const strings = [];
    if (!ghost) {
      structure.muscles.forEach((name, k) => {
        const mesh = new THREE.Mesh(rod, new THREE.MeshStandardMaterial({ roughness: 0.6 }));
        mesh.userData.muscle = k;
        group.add(mesh);
        strings.push(mesh);
        parts.push((body, now) => {
          const [a, b] = [0, 1].map((end) => vector(moved(body.muscles[2 * k + end], structure.ends[k][end], body, now)));
          const along = b.clone().sub(a);
          const length = along.length() || 1e-6;
          mesh.position.copy(a).addScaledVector(along, 0.5);
          mesh.quaternion.setFromUnitVectors(UP(), along.divideScalar(length));
          const radius = 0.0028 + 0.005 * Math.min(body.activation[k] / scaleOf(), 1);
          mesh.scale.set(radius, length, radius);
        });
      });
    }
    return {
      group, body: null,
      wear(body) {
        this.body = body;
        strings.forEach((mesh, k) => { const [r, g, b] = look.activation(body.activation[k] / scaleOf()); mesh.material.color.setRGB(r / 255, g / 255, b / 255, "srgb"); });
      },
      pose(phase) {
        const now = motion(this.body, phase);
        parts.forEach((part) => part(this.body, now));
      },
    };
  }

  // activations are coloured from 0 to the largest of any pilot in the page, not below 0.2
  let largest = null;
  function scaleOf() {
    if (largest === null) {
      largest = 0.2;
      for (const pilot of stored()) for (const a of skeleton(pilot).activation) largest = Math.max(largest, a);
      largest = Math.ceil(20 * largest) / 20;
    }
    return largest;
  }

  let arrow;

  function start(canvasHost) {
    host = canvasHost;
    structure = model.data.skeletons.structure;
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    } catch (error) {
      host.replaceChildren(text.element("p", { class: "note" }, "This browser draws nothing in 3-D here (WebGL is off): turn it on to see the pilot."));
      return false;
    }
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    host.prepend(renderer.domElement);
    renderer.domElement.setAttribute("role", "img");
    renderer.domElement.setAttribute("aria-label", "The chosen pilot in his seat in three dimensions, with bones and muscles of the arms in the deck");
    scene = new THREE.Scene();
    world = new THREE.Group();
    scene.add(world);
    scene.add(new THREE.HemisphereLight(0xffffff, 0x777788, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, 3, -2.5);
    scene.add(sun);
    camera = new THREE.PerspectiveCamera(30, 1, 0.05, 20);
    controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.enablePan = true;
    renderer.domElement.style.touchAction = "pan-y"; // a finger that goes up or down scrolls the page
    controls.addEventListener("change", draw);
    arrow = new THREE.ArrowHelper(UP(), new THREE.Vector3(), 0.3, 0xd55e00, 0.06, 0.04);
    scene.add(arrow);
    chosen = puppet(false);
    nominal = puppet(true);
    new ResizeObserver(resize).observe(host);
    renderer.domElement.addEventListener("pointermove", hover);
    renderer.domElement.addEventListener("pointerleave", () => pilotgen.tip.show(null));
    state.on("pilot", show);
    state.on("look", draw);
    show();
    resize();
    look3d("reset");
    return true;
  }

  function shownPilot() {
    const all = stored();
    if (state.pilot === null) return all[0];
    return all.includes(state.pilot) ? state.pilot : model.nearest(state.pilot, all);
  }

  function show() {
    const pilot = shownPilot();
    chosen.wear(skeleton(pilot));
    const other = model.data.nominal;
    const both = settings.nominal !== "off" && other !== null && other !== pilot && stored().includes(other);
    nominal.group.visible = both;
    nominal.wear(skeleton(both ? other : pilot));
    const beside = both && settings.nominal === "beside";
    nominal.group.position.set(0, 0, beside ? 0.95 : 0);
    draw();
  }

  function resize() {
    const [wide, high] = [host.clientWidth, host.clientHeight];
    if (!wide || !high) return;
    renderer.setSize(wide, high, false);
    camera.aspect = wide / high;
    camera.updateProjectionMatrix();
    draw();
  }

  function look3d(name) {
    const beside = nominal.group.visible && settings.nominal === "beside";
    const target = new THREE.Vector3(0.24, 0.18, beside && name !== "side" ? 0.42 : 0);
    const reach = (beside && name !== "side" ? 3.5 : 3.0) / Math.min(camera.aspect, 1);
    const [x, y, z] = VIEWS[name][0];
    const from = new THREE.Vector3(x, y, z).normalize().multiplyScalar(reach);
    controls.target.copy(target);
    camera.position.copy(target).add(from);
    controls.update();
    draw();
  }

  function draw() {
    if (frame || !renderer) return;
    frame = requestAnimationFrame(render);
  }

  function render(time) {
    frame = 0;
    if (settings.playing && settings.motion !== "none") {
      clock += Math.min((time - last) / 1000, 0.05) * 2 * Math.PI * Math.min(hz(), 1.2); // no faster than the eye follows
    }
    last = time;
    paint();
    if (settings.playing && settings.motion !== "none") draw();
  }

  function paint() {
    chosen.pose(clock);
    if (nominal.group.visible) nominal.pose(clock);
    const now = motion(chosen.body, clock);
    const [x, y] = chosen.body.sizes.seat_m;
    const length = settings.motion === "response" ? now.seat[structure.axis] : 0;
    arrow.visible = settings.motion === "response";
    arrow.position.set(x + 0.1, y - 0.02, -0.42); // beside the seat, on the collective's side
    arrow.setDirection(new THREE.Vector3().setComponent(structure.axis, length < 0 ? -1 : 1));
    arrow.setLength(Math.max(Math.abs(length) * 2, 0.02), Math.min(0.06, Math.abs(length) + 0.01), 0.04);
    renderer.render(scene, camera);
  }

  const caster = () => new THREE.Raycaster();
  function hover(event) {
    if (event.buttons) return;
    const rect = renderer.domElement.getBoundingClientRect();
    const place = { left: event.clientX - rect.left, top: event.clientY - rect.top };
    const ray = caster();
    ray.setFromCamera(new THREE.Vector2(2 * place.left / rect.width - 1, 1 - 2 * place.top / rect.height), camera);
    const hits = ray.intersectObject(chosen.group, true);
    const hit = hits.find((one) => one.object.userData.muscle !== undefined || /_[lr]$/.test(one.object.userData.about || "")) || hits[0];
    pilotgen.tip.show(renderer.domElement, place, hit ? told(hit.object.userData) : null);
  }

  function told({ muscle, about }) {
    if (muscle !== undefined) {
      return [structure.muscles[muscle], `activation ${text.number(chosen.body.activation[muscle], 3)}`];
    }
    const [bone, side] = (about || "").split(/_(?=[lr]$)/);
    if (!side) return about ? [about] : null;
    const prefix = side === "r" ? "right_" : "";
    const joint = JOINTS_OF[bone];
    const angles = Object.entries(chosen.body.joints).filter(([name]) => name.startsWith(prefix + joint) && (side === "r" || !name.startsWith("right_")));
    return [`${bone}, ${side === "l" ? "left" : "right"}`, ...angles.map(([name, angle]) => `${name.replace(prefix, "").replace("_deg", "").replace(/_/g, " ")} ${text.number(angle, 1)}°`)];
  }

  function set(changes) {
    Object.assign(settings, changes);
    if (changes.nominal) { show(); look3d("reset"); }
    draw();
  }

  // where a place of the drawing is on the canvas, in CSS pixels
  function project(name, kind = "points") {
    const k = (kind === "points" ? structure.points : structure.nodes).indexOf(name);
    const node = kind === "points" ? structure.carriers[k] : k;
    const p = vector(moved(chosen.body[kind][k], node, chosen.body, motion(chosen.body, clock)));
    camera.updateMatrixWorld(); // it may have moved since it was drawn
    p.project(camera);
    return [(p.x + 1) / 2 * host.clientWidth, (1 - p.y) / 2 * host.clientHeight];
  }

  return {
    start, set, look3d, project, skeleton, shownPilot, settings,
    view: () => ({ eye: camera.position.toArray(), target: controls.target.toArray(), fov_deg: camera.fov, size: [host.clientWidth, host.clientHeight] }),
    picture() { paint(); return renderer.domElement.toDataURL("image/png"); },
    get shown() { return chosen ? chosen.body.pilot : null; },
    get scale() { return scaleOf(); },
    at(phase) { clock = phase; paint(); },
    place: (name) => { const k = structure.points.indexOf(name); return moved(chosen.body.points[k], structure.carriers[k], chosen.body, motion(chosen.body, clock)); },
    ready: () => renderer !== undefined && chosen !== null,
  };
})();
