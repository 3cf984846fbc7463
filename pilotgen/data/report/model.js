// What a page knows of its pilots: columns, and responses computed from poles, residues and the rotorcraft.
"use strict";

pilotgen.model = (() => {
  const LOW_HZ = 0.1, HIGH_HZ = 20, POINTS = 420;
  let data, columns, byKey, offsets, numbers, total;
  const curves = new Map();

  function load(given) {
    data = given;
    columns = data.columns.map((column) => ({
      ...column, values: pilotgen.decode[column.wide ? "wide" : "short"](column.data), data: null,
    }));
    byKey = new Map(columns.map((column) => [column.key, column]));
    total = data.stable.length;
    numbers = pilotgen.decode.short(data.terms.data);
    offsets = new Int32Array(total + 1);
    for (let k = 0; k < total; k += 1) {
      offsets[k + 1] = offsets[k] + 8 / 2 * data.terms.counts[2 * k] + 2 * data.terms.counts[2 * k + 1];
    }
  }

  const value = (key, pilot) => (byKey.has(key) ? byKey.get(key).values[pilot] : NaN);
  const evaluated = (pilot) => data.stable[pilot] >= 0;
  const hasCurves = (pilot) => data.terms.counts[2 * pilot] + data.terms.counts[2 * pilot + 1] > 0 && plantOf(pilot) !== null;

  // ---- complex arithmetic on [re, im]
  const times = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
  function over(a, b) {
    const d = b[0] * b[0] + b[1] * b[1];
    return [(a[0] * b[0] + a[1] * b[1]) / d, (a[1] * b[0] - a[0] * b[1]) / d];
  }

  function plantOf(pilot) {
    const { each, of } = data.plants;
    const k = of === null ? 0 : of[pilot];
    return k >= 0 ? each[k] : null;
  }

  // sum of residue / (s - pole), a complex pole with its conjugate, at s = j w
  function sum(list, w) {
    let re = list.direct, im = 0;
    for (const [a, b, c, d] of list.pairs) {
      // (c + jd)/(j(w - b) - a) + (c - jd)/(j(w + b) - a)
      let n = a * a + (w - b) * (w - b);
      re += (-c * a + d * (w - b)) / n;
      im += (-d * a - c * (w - b)) / n;
      n = a * a + (w + b) * (w + b);
      re += (-c * a - d * (w + b)) / n;
      im += (d * a - c * (w + b)) / n;
    }
    for (const [a, c] of list.real) {
      const n = a * a + w * w;
      re += -c * a / n;
      im += -c * w / n;
    }
    return [re, im];
  }

  function termsOf(pilot) {
    const pairs = [], real = [];
    let k = offsets[pilot];
    for (let j = 0; j < data.terms.counts[2 * pilot]; j += 1, k += 4) pairs.push(Array.from(numbers.subarray(k, k + 4)));
    for (let j = 0; j < data.terms.counts[2 * pilot + 1]; j += 1, k += 2) real.push(Array.from(numbers.subarray(k, k + 2)));
    return { pairs, real, direct: data.terms.direct[pilot] || 0, integrators: data.terms.integrators, tilt: data.terms.tilt[pilot] || null };
  }

  function listOf(terms) {
    const pairs = [], real = [];
    terms.poles_rad_s.forEach((pole, k) => {
      if (pole[1] !== 0) pairs.push([...pole, ...terms.residues[k]]);
      else real.push([pole[0], terms.residues[k][0]]);
    });
    return { pairs, real, direct: terms.direct, integrators: terms.integrators, tilt: terms.tilt || null };
  }

  // rotation of the control per acceleration of the seat; a seat that turns tilts gravity
  function rotation(list, w, corner) {
    const own = filtered(list, w, corner);
    if (!list.tilt) return own;
    const below = corner === null ? [0, w] : [corner, w];
    const more = over(over([list.tilt[0], list.tilt[1] * w], below), below);
    return [own[0] + more[0], own[1] + more[1]];
  }

  function filtered(list, w, corner) {
    let H = sum(list, w);
    if (corner === null) {
      for (let k = 0; k < list.integrators; k += 1) H = over(H, [0, w]);
      return H;
    }
    for (let k = list.integrators; k < 2; k += 1) H = times(H, [0, w]);
    return over(over(H, [corner, w]), [corner, w]);
  }

  // C (jw - A)^-1 B + D by elimination with pivots, and the delay
  function vehicle(plant, w) {
    const n = plant.A.length;
    const M = plant.A.map((row, i) => row.map((a, j) => [-a, i === j ? w : 0]).concat([[plant.B[i], 0]]));
    for (let k = 0; k < n; k += 1) {
      let p = k;
      for (let i = k + 1; i < n; i += 1) if (Math.hypot(...M[i][k]) > Math.hypot(...M[p][k])) p = i;
      [M[k], M[p]] = [M[p], M[k]];
      for (let i = k + 1; i < n; i += 1) {
        if (M[i][k][0] === 0 && M[i][k][1] === 0) continue;
        const f = over(M[i][k], M[k][k]);
        for (let j = k; j <= n; j += 1) {
          const t = times(f, M[k][j]);
          M[i][j] = [M[i][j][0] - t[0], M[i][j][1] - t[1]];
        }
      }
    }
    const x = new Array(n);
    let H = [plant.D, 0];
    for (let i = n - 1; i >= 0; i -= 1) {
      let r = M[i][n];
      for (let j = i + 1; j < n; j += 1) {
        const t = times(M[i][j], x[j]);
        r = [r[0] - t[0], r[1] - t[1]];
      }
      x[i] = over(r, M[i][i]);
      H = [H[0] + plant.C[i] * x[i][0], H[1] + plant.C[i] * x[i][1]];
    }
    if (plant.spline) H = times(H, measured(plant.spline, w));
    return plant.delay_s ? times(H, [Math.cos(w * plant.delay_s), -Math.sin(w * plant.delay_s)]) : H;
  }

  // a response that is known at frequencies, by cubic splines in ln w; no number outside its band
  function measured({ ends, pieces }, w) {
    const x = Math.log(w), n = ends.length - 1;
    if (x < ends[0] - 1e-12 || x > ends[n] + 1e-12) return [NaN, NaN];
    let k = 0;
    while (k < n - 1 && x > ends[k + 1]) k += 1;
    const t = x - ends[k];
    return [0, 1].map((part) => [0, 1, 2, 3].reduce((value, power) => value * t + pieces[(power * n + k) * 2 + part], 0));
  }

  function at(list, plant, hz) {
    const w = 2 * Math.PI * hz;
    const phi = rotation(list, w, plant.washout_rad_s);
    const L = times(phi, vehicle(plant, w));
    const l = plant.lever_length_m;
    return { grip: [l * phi[0], l * phi[1]], loop: [plant.gain * L[0], plant.gain * L[1]] };
  }

  const grip = (pilot, hz, washout = true) => {
    const plant = plantOf(pilot);
    const H = rotation(termsOf(pilot), 2 * Math.PI * hz, washout ? plant.washout_rad_s : null);
    return [plant.lever_length_m * H[0], plant.lever_length_m * H[1]];
  };
  const loop = (pilot, hz) => at(termsOf(pilot), plantOf(pilot), hz).loop;

  function gridOf(list, plant, extra) {
    const found = [];
    for (let k = 0; k < POINTS; k += 1) found.push(LOW_HZ * (HIGH_HZ / LOW_HZ) ** (k / (POINTS - 1)));
    for (const [a, b] of list.pairs) {
      if (Math.abs(a) > 0.25 * Math.abs(b)) continue; // only what a plain grid could miss
      for (let k = -20; k <= 20; k += 1) found.push((Math.abs(b) + 0.2 * k * Math.abs(a)) / (2 * Math.PI));
    }
    found.push(...extra.filter(Number.isFinite));
    const ends = plant.spline ? plant.spline.ends.map((x) => Math.exp(x) / (2 * Math.PI)) : [LOW_HZ, HIGH_HZ];
    const [low, high] = [Math.max(LOW_HZ, ends[0]), Math.min(HIGH_HZ, ends.at(-1))];
    return Float64Array.from(found.filter((hz) => hz >= low && hz <= high)).sort();
  }

  function curveOf(list, plant, extra) {
    const hz = gridOf(list, plant, extra);
    const n = hz.length;
    const curve = { hz, re: new Float64Array(n), im: new Float64Array(n), db: new Float64Array(n), deg: new Float64Array(n),
      mm: new Float64Array(n), gripDeg: new Float64Array(n) };
    let loudest = 0;
    for (let k = 0; k < n; k += 1) {
      const { grip: G, loop: L } = at(list, plant, hz[k]);
      curve.re[k] = L[0];
      curve.im[k] = L[1];
      curve.db[k] = 20 * Math.log10(Math.hypot(...L));
      curve.deg[k] = Math.atan2(L[1], L[0]) * 180 / Math.PI;
      curve.mm[k] = 1e3 * Math.hypot(...G);
      curve.gripDeg[k] = Math.atan2(G[1], G[0]) * 180 / Math.PI;
      if (curve.db[k] > curve.db[loudest]) loudest = k;
    }
    for (const phase of [curve.deg, curve.gripDeg]) {
      for (let k = 1; k < n; k += 1) phase[k] -= 360 * Math.round((phase[k] - phase[k - 1]) / 360);
      const turn = 360 * Math.round((phase[loudest] + 180) / 360); // at the largest |L| between -360 and 0
      for (let k = 0; k < n; k += 1) phase[k] -= turn;
    }
    return curve;
  }

  function curve(pilot) {
    if (!hasCurves(pilot)) return null;
    if (!curves.has(pilot)) {
      if (curves.size > 400) curves.clear();
      const extra = ["gain_margin_hz", "phase_margin_hz", "modulus_margin_hz"].map((key) => value(key, pilot));
      curves.set(pilot, curveOf(termsOf(pilot), plantOf(pilot), extra));
    }
    return curves.get(pilot);
  }

  const referenceCurves = () => data.references.map((one) => ({
    name: one.name, ...curveOf(listOf(one.terms), data.plants.each[0], []),
  }));

  // balanced disk margin min 2 |1 + L| / |1 - L| of a stable loop, refined between points of the curve
  function disk(pilot) {
    const known = curve(pilot);
    if (known === null || data.stable[pilot] !== 1) return { value: 0, hz: NaN };
    const list = termsOf(pilot), plant = plantOf(pilot);
    const size = ([re, im]) => 2 * Math.hypot(1 + re, im) / Math.hypot(1 - re, im);
    let best = 0;
    for (let k = 1; k < known.hz.length; k += 1) {
      if (size([known.re[k], known.im[k]]) < size([known.re[best], known.im[best]])) best = k;
    }
    let a = known.hz[Math.max(best - 1, 0)], b = known.hz[Math.min(best + 1, known.hz.length - 1)];
    for (let k = 0; k < 60; k += 1) {
      const p = b - 0.618033988749895 * (b - a), q = a + 0.618033988749895 * (b - a);
      if (size(at(list, plant, p).loop) < size(at(list, plant, q).loop)) b = q; else a = p;
    }
    const hz = (a + b) / 2;
    return { value: size(at(list, plant, hz).loop), hz };
  }

  // the evaluated pilot, of those allowed, nearest in the searched variables
  function nearest(pilot, allowed) {
    const variables = columns.filter((column) => column.role === "variable");
    let best = -1, least = Infinity;
    for (const other of allowed) {
      let far = 0;
      for (const column of variables) {
        const width = column.box[1] - column.box[0] || 1;
        far += ((column.values[other] - column.values[pilot]) / width) ** 2;
      }
      if (far < least) [best, least] = [other, far];
    }
    return best;
  }

  return {
    load, value, evaluated, hasCurves, grip, loop, curve, referenceCurves, disk, nearest, plantOf,
    get data() { return data; },
    get columns() { return columns; },
    get total() { return total; },
    column: (key) => byKey.get(key),
    LOW_HZ, HIGH_HZ,
  };
})();
