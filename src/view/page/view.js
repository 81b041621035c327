(() => {
  const ask = async (path) => {
    const answer = await fetch(path, { headers, cache: "no-store", signal: AbortSignal.timeout(120000) });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return answer;
  };
  const fixed = (v, digits) => v.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−");
  const number = (v) => {
    if (v === null || v === undefined || !isFinite(v)) return "–";
    const size = Math.abs(v);
    if (size !== 0 && (size < 1e-4 || size >= 1e6)) return v.toExponential(3).replace("-", "−");
    return fixed(v, size < 1 ? 5 : size < 100 ? 3 : 1);
  };
  const seconds = (t) => fixed(t, 3) + " s";
  const failed = (error) => {
    const lost = error instanceof TypeError || error.name === "TimeoutError";
    put("gone", lost ? "No answer from hydroline: it has ended, or does not answer." : error.message);
    show("gone", true);
  };

  // --- what is looked at -------------------------------------------------------------------------------------------
  let logs = [];
  let now = 0, first = 0, last = 1, view = [0, 1], range = null, playing = null;
  const plots = [];
  const names = ["blue", "orange", "green", "purple"];
  const dashes = [[], [8, 4], [2, 3], [10, 3, 2, 3]];
  const keyOf = (f) => f.topic + "\n" + f.key + "\n" + f.path;
  const turned = (path) => path.replace(/\[\d+\]$/, "").match(/_(rad|radps)$/);
  const labelOf = (f) => {
    const turn = turned(f.path);
    const unit = turn ? (turn[1] === "rad" ? " [°]" : " [°/s]") : "";
    return (f.key ? f.key + " " : "") + f.path + unit;
  };
  const factorOf = (f) => (turned(f.path) ? 180 / Math.PI : 1);

  // --- plots -------------------------------------------------------------------------------------------------------
  const axis = (label, extra) => ({
    stroke: () => colour("soft"), grid: { stroke: () => colour("grid"), width: 1 }, ticks: { stroke: () => colour("grid"), width: 1 },
    font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", label, labelSize: label ? 18 : 0, ...extra,
  });
  const around = (low, high) => {
    if (low === null) return [-1, 1];
    const air = 0.08 * (high - low) || Math.max(1e-9, 0.01 * Math.abs(high));
    return [low - air, high + air];
  };
  const HEIGHT = 180;
  const shades = { info: "soft", warning: "orange", error: "stop" };
  const events = [];
  const marks = (u) => {
    const pen = u.ctx, { left, top, width, height } = u.bbox;
    pen.save();
    pen.globalAlpha = 0.5;
    pen.setLineDash([]);
    for (const e of events) {
      if (e.t_s < view[0] || e.t_s > view[1]) continue;
      const x = Math.round(u.valToPos(e.t_s, "x", true)) + 0.5;
      if (x < left || x > left + width) continue;
      pen.strokeStyle = colour(shades[e.severity]);
      pen.lineWidth = e.severity === "info" ? 1 : 2;
      pen.beginPath();
      pen.moveTo(x, top);
      pen.lineTo(x, top + (e.severity === "info" ? 0.08 * height : height));
      pen.stroke();
    }
    pen.restore();
  };
  // The curves of a plot, one for each of its fields in each log that has it.
  // Where motion and truth share a plot, a log shows its truth only where it has no motion.
  const MOTION = "/vehicle/motion", TRUTH = "/sim/truth", PREDICTED = "predicted", RESIDUAL = "measured − predicted";
  const has = (log, topic) => log.fields.some((f) => f.topic === topic);
  const isHeld = (f) => f.topic.startsWith("/thruster/");
  const curvesOf = (p) => {
    const names = [...new Set(p.fields.map((f) => f.key + "\n" + f.path))];
    const stands_in = p.fields.some((f) => f.topic === MOTION);
    return logs.flatMap((log, l) => p.fields
      .filter((f) => !(stands_in && f.topic === TRUTH && has(log, MOTION)))
      .map((f) => ({ log: l, field: f, k: names.indexOf(f.key + "\n" + f.path), number: log.numbers.get(keyOf(f)) }))
      .filter((c) => c.number !== undefined));
  };
  const build = (p) => {
    if (p.u) p.u.destroy();
    p.curves = curvesOf(p);
    const one = p.fields.length === 1;
    p.curves.forEach((c) => { c.name = names[(one ? c.log : c.k) % 4]; c.dash = c.field.topic === PREDICTED ? dashes[2] : one ? [] : dashes[c.log % 4]; });
    p.u = new uPlot({
      width: Math.max(p.box.clientWidth, 200), height: HEIGHT, legend: { show: false },
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false } },
      scales: { x: { time: false, range: () => view }, y: { range: (_, low, high) => around(low, high) } },
      axes: [axis("", {}), axis("", { size: 56 })],
      series: [{}, ...p.curves.map((c) => ({ stroke: () => colour(c.name), width: 1.5, dash: c.dash, points: { show: false }, ...(isHeld(c.field) ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}) }))],
      hooks: { draw: [marks, () => placeIn(p)], setSelect: [(u) => chosen(u)] },
    }, [[]].concat(p.curves.map(() => [])), p.box);
    p.line = make("div", "line");
    p.span = make("div", "span");
    p.u.over.append(p.span, p.line);
    let down = 0;
    p.u.over.addEventListener("mousedown", (e) => { down = e.clientX; });
    p.u.over.addEventListener("mouseup", (e) => { if (Math.abs(e.clientX - down) < 3) go(p.u.posToVal(e.offsetX, "x")); });
    p.lines.replaceChildren(...p.curves.map((c) => {
      const row = make("span");
      const key = make("i");
      key.style.borderTopColor = "var(--" + c.name + ")";
      if (c.dash.length) key.style.borderTopStyle = c.dash[0] < 4 ? "dotted" : "dashed";
      c.value = make("b", "", "–");
      row.append(key, labelOf(c.field) + (p.fields.some((f) => f.topic !== p.fields[0].topic) ? " of " + c.field.topic : "") + (logs.length > 1 ? " · " + logs[c.log].name : "") + " ", c.value);
      return row;
    }));
    fill(p);
  };
  const chosen = (u) => {
    if (u.select.width < 3) return;
    setRange(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  };
  const addPlot = (fields) => {
    const p = { fields: [], curves: [], box: make("div"), lines: make("div", "lines") };
    const section = make("section", "plot");
    const head = make("h2");
    p.title = make("span");
    const gone = make("button", "", "×");
    gone.type = "button";
    gone.addEventListener("click", () => {
      plots.splice(plots.indexOf(p), 1);
      p.u.destroy();
      section.remove();
      listPlots();
    });
    p.gone = gone;
    head.append(p.title, gone);
    section.append(head, p.box, p.lines);
    $("plots").insertBefore(section, $("add-box"));
    plots.push(p);
    new ResizeObserver(() => { if (p.u && p.box.clientWidth > 50 && p.box.clientWidth !== p.u.width) { p.u.setSize({ width: p.box.clientWidth, height: HEIGHT }); place(); } }).observe(p.box);
    fields.forEach((f) => addField(p, f));
  };
  const addField = (p, f) => {
    if (p.fields.some((own) => keyOf(own) === keyOf(f))) return;
    p.fields.push(f);
    p.title.textContent = [...new Set(p.fields.map((own) => own.topic))].join(", ");
    p.gone.setAttribute("aria-label", "Remove the plot of " + p.title.textContent);
    build(p);
    listPlots();
    refresh();
  };
  const listPlots = () => {
    const into = $("into"), had = into.value;
    into.replaceChildren(...["a new plot", ...plots.map((p, k) => "plot " + (k + 1) + ": " + p.fields.map(labelOf).join(", ").slice(0, 40))].map((words, k) => {
      const o = make("option", "", words);
      o.value = String(k - 1);
      return o;
    }));
    if ([...into.options].some((o) => o.value === had)) into.value = had;
  };

  // --- numbers -----------------------------------------------------------------------------------------------------
  // Where samples are missing a line must not go on: a gap of many times the usual distance.
  const broken = (s, factor, isHeld) => {
    const { t, v } = s, gaps = [];
    for (let k = 1; k < t.length; k++) gaps.push(t[k] - t[k - 1]);
    const usual = gaps.slice().sort((a, b) => a - b)[gaps.length >> 1] || 0;
    // A command holds until the next one.
    const most = isHeld ? Infinity : Math.max(20 * usual, 0.5);
    const x = [], y = [];
    for (let k = 0; k < t.length; k++) {
      if (k && t[k] - t[k - 1] > most) { x.push(t[k - 1] + 1e-6); y.push(null); }
      // Times of one plot ascend strictly.
      x.push(x.length && t[k] <= x[x.length - 1] ? x[x.length - 1] + 1e-9 : t[k]);
      y.push(v[k] * factor);
    }
    // How far from a sample its value still counts.
    return Object.assign([x, y], { reach: Math.min(most, 1e9), isHeld });
  };
  const fill = (p) => {
    if (!p.u) return;
    const tables = p.curves.map((c) => (c.data ? c.data : [[], []]));
    p.u.setData(tables.length ? uPlot.join(tables, tables.map(() => [1, 1])) : [[]]);
    place();
  };
  let asked = 0;
  const refresh = async () => {
    const turn = ++asked;
    await pause(30);
    for (;;) {
      if (turn !== asked) return;
      let least = 1;
      for (let l = 0; l < logs.length; l++) {
        const curves = plots.flatMap((p) => p.curves.filter((c) => c.log === l));
        const wanted = [...new Set(curves.map((c) => c.number))];
        for (let k = 0; k < wanted.length; k += 40) {
          const pixels = Math.round(Math.max(200, ...plots.map((p) => p.box.clientWidth)) * Math.min(devicePixelRatio, 2));
          let found;
          try {
            found = await (await ask("/series?log=" + l + "&of=" + wanted.slice(k, k + 40).join(",") + "&from=" + view[0] + "&to=" + view[1] + "&pixels=" + pixels)).json();
          } catch (error) { failed(error); await pause(1000); least = 0; continue; }
          if (turn !== asked) return;
          show("gone", false);
          least = Math.min(least, found.read);
          for (const s of found.series) {
            const same = curves.filter((c) => c.number === s.number);
            same.forEach((c) => { c.data = broken(s, factorOf(c.field), isHeld(c.field)); });
          }
          if (found.read === 1 && found.fields > logs[l].fields_met) await learn();
        }
      }
      plots.forEach(fill);
      put("reading", least < 1 ? "reading the log: " + Math.floor(100 * least) + " %" : "");
      if (least === 1) return;
    }
  };

  // --- time --------------------------------------------------------------------------------------------------------
  const valueAt = (data, t) => {
    if (!data || !data[0].length) return null;
    const x = data[0];
    let low = 0, high = x.length - 1;
    while (low < high) { const mid = (low + high + 1) >> 1; if (x[mid] <= t) low = mid; else high = mid - 1; }
    const next = Math.min(low + 1, x.length - 1);
    if (data.isHeld) return x[low] > t ? null : data[1][low];
    const k = Math.abs(x[next] - t) < Math.abs(x[low] - t) ? next : low;
    return Math.abs(x[k] - t) > data.reach ? null : data[1][k];
  };
  // Behind a new scale the marks go where it has them: the plot calls this once it is drawn.
  const placeIn = (p) => {
    if (!p.u || !p.line) return;
    const at = (t) => p.u.valToPos(Math.min(view[1], Math.max(view[0], t)), "x");
    p.line.style.left = at(now) + "px";
    p.line.hidden = now < view[0] || now > view[1];
    p.span.hidden = !range;
    if (range) { p.span.style.left = at(range[0]) + "px"; p.span.style.width = Math.max(1, at(range[1]) - at(range[0])) + "px"; }
    for (const c of p.curves) { const words = number(valueAt(c.data, now)); if (c.value.textContent !== words) c.value.textContent = words; }
  };
  const place = () => plots.forEach(placeIn);
  const go = (t) => {
    now = Math.min(last, Math.max(first, t));
    put("now", seconds(now));
    $("slider").value = String(now);
    $("slider").setAttribute("aria-valuetext", seconds(now));
    if (now < view[0] || now > view[1]) look([now - (view[1] - view[0]) / 2, now + (view[1] - view[0]) / 2]);
    place();
    wantFrame({ t: now });
  };
  const look = (v) => {
    const long = Math.min(Math.max(v[1] - v[0], 1e-3), last - first);
    const from = Math.min(Math.max(v[0], first), last - long);
    view = [from, from + long];
    plots.forEach((p) => p.u && p.u.redraw(false, true));
    place();
    refresh();
  };
  const setRange = (a, b) => {
    range = b > a ? [Math.max(first, a), Math.min(last, b)] : null;
    for (const id of ["clear", "closer", "copy"]) $(id).disabled = !range;
    const words = (log) => {
      const at = (t) => String(Math.max(0, +(t - log.window_zero_s).toFixed(3)));
      return /[\s'"\\$&|;<>()*?]/.test(log.path) ? "'" + log.path.replaceAll("'", "'\\''") + "@" + at(range[0]) + ".." + at(range[1]) + "'" : log.path + "@" + at(range[0]) + ".." + at(range[1]);
    };
    put("window", range ? logs.map(words).join("\n") : "");
    place();
  };
  const play = (on) => {
    playing = on ? { at: performance.now() } : null;
    put("play", on ? "Pause" : "Play");
    if (!on) return;
    if (now >= last) go(first);
    const step = (at) => {
      if (!playing) return;
      const t = now + Number($("speed").value) * (at - playing.at) / 1e3;
      playing.at = at;
      go(Math.max(t, now));
      if (now >= last) play(false); else requestAnimationFrame(step);
    };
    playing.at = performance.now();
    requestAnimationFrame(step);
  };
  const stepFrame = (way) => {
    play(false);
    const log = logs[$("which").value || 0];
    if (log.images.length && shown) wantFrame({ at: shown.at, step: way < 0 ? "previous" : "next" });
    else go(now + way * (view[1] - view[0]) / 500);
  };

  // --- the picture -------------------------------------------------------------------------------------------------
  let shown = null, wish = null, busy = false, profile = null;
  const wantFrame = (what) => { wish = what; if (!busy) nextFrame(); };
  const nextFrame = async () => {
    busy = true;
    while (wish) {
      const what = wish, l = Number($("which").value || 0), log = logs[l];
      wish = null;
      if (!log || !log.images.length) break;
      const zoomed = $("zoom").checked;
      const path = "/frame?log=" + l + "&topic=" + ($("images").value || 0) + (what.step ? "&at=" + what.at + "&step=" + what.step : "&t=" + what.t)
        + ($("stripe").checked || zoomed ? "&stripe=1" : "") + (zoomed ? "&full=1" : "");
      try {
        const bytes = await (await ask(path)).arrayBuffer();
        const length = new DataView(bytes).getUint32(0, true);
        const words = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
        const jpeg = new Uint8Array(bytes, 4 + length);
        const bitmap = jpeg.length ? await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })) : null;
        if (shown && shown.bitmap) shown.bitmap.close();
        shown = { ...words, bitmap, log: l };
        drawPicture();
        if (what.step) { now = Math.min(last, Math.max(first, words.t)); put("now", seconds(now)); $("slider").value = String(now); if (now < view[0] || now > view[1]) look([now - (view[1] - view[0]) / 2, now + (view[1] - view[0]) / 2]); place(); }
      } catch (error) {
        if (what.step && /no frame/.test(error.message)) continue;
        failed(error);
        await pause(300);
      }
    }
    busy = false;
  };
  const cut = (o) => {
    // The stripe with some of its surroundings, as wide as the picture is.
    const all = [0, 0, o.width_px, o.height_px];
    if (!$("zoom").checked || o.stripe_px.length < 2) return all;
    const rows = o.stripe_px.map((p) => p[1]);
    const low = Math.min(...rows), high = Math.max(...rows), air = Math.max(12, 0.25 * (high - low));
    const top = Math.max(0, Math.floor(low - air)), bottom = Math.min(o.height_px, Math.ceil(high + air));
    return [0, top, o.width_px, Math.max(8, bottom - top)];
  };
  const drawPicture = () => {
    const o = shown.overlay, canvas = $("picture"), pen = canvas.getContext("2d");
    const width = o.width_px || (shown.bitmap ? shown.bitmap.width : 720), height = o.height_px || (shown.bitmap ? shown.bitmap.height : 576);
    const [x, y, w, h] = cut({ ...o, width_px: width, height_px: height });
    // Rows of a strip are drawn several times as high, so that it can be looked into.
    const tall = h < height / 2 ? Math.max(1, Math.min(8, Math.floor(height / (2 * h)))) : 1;
    canvas.width = w;
    canvas.height = h * tall;
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    if (shown.bitmap) {
      const f = shown.bitmap.width / width;
      pen.imageSmoothingEnabled = tall === 1;
      pen.drawImage(shown.bitmap, x * f, y * f, w * f, h * f, 0, 0, canvas.width, canvas.height);
    }
    if ($("stripe").checked) {
      pen.strokeStyle = "#e0c000";
      pen.lineWidth = Math.max(1.5, width / 640);
      pen.beginPath();
      let before = null;
      for (const p of o.stripe_px) {
        const next = [p[0] + 0.5 - x, (p[1] + 0.5 - y) * tall];
        // A step of the stripe, or a gap in it, is no line.
        const near = before && p[0] - before[0] <= 8 && Math.abs(p[1] - before[1]) <= 4;
        if (near) pen.lineTo(next[0], next[1]); else pen.moveTo(next[0], next[1]);
        before = p;
      }
      pen.stroke();
    }
    show("no-picture", !shown.bitmap);
    put("no-picture", o.fault || "no picture");
    put("picture-note", "at " + seconds(shown.t) + ", number " + o.sequence + (logs.length > 1 ? ", " + logs[shown.log].name : "") + (tall > 1 ? ", rows ×" + tall : "") + (o.fault && shown.bitmap ? "; " + o.fault : ""));
    show("profile-box", o.profile_m.length > 0);
    if (!o.profile_m.length) return;
    if (!profile) {
      const box = $("profile");
      profile = new uPlot({
        width: Math.max(box.clientWidth, 200), height: 170, cursor: { drag: { x: false, y: false } }, legend: { show: false },
        scales: { x: { time: false }, y: { range: (_, low, high) => around(low, high) } }, axes: [axis("", {}), axis("", { size: 56 })],
        series: [{}, { stroke: () => colour("orange"), width: 0, points: { show: true, size: 3, fill: () => colour("orange"), stroke: () => colour("orange") } }],
      }, [[], []], box);
      new ResizeObserver(() => { if (box.clientWidth > 50 && box.clientWidth !== profile.width) profile.setSize({ width: box.clientWidth, height: 170 }); }).observe(box);
    }
    const rows = o.profile_m.slice().sort((a, b) => a[0] - b[0]);
    profile.setData([rows.map((r) => r[0]), rows.map((r) => r[1])]);
  };

  // --- files -------------------------------------------------------------------------------------------------------
  const save = (blob, name) => {
    const a = make("a"), place = URL.createObjectURL(blob);
    a.download = name;
    a["href"] = place;
    a.click();
    setTimeout(() => URL.revokeObjectURL(place), 10000);
  };
  const fetched = async (path) => {
    try {
      const answer = await ask(path);
      const name = /filename="([^"]*)"/.exec(answer.headers.get("content-disposition") || "");
      save(await answer.blob(), name ? name[1] : "hydroline");
    } catch (error) { failed(error); }
  };
  $("csv").addEventListener("click", async () => {
    const [from, to] = range || view;
    for (let l = 0; l < logs.length; l++) {
      const of = [...new Set(plots.flatMap((p) => p.curves.filter((c) => c.log === l).map((c) => c.number)))];
      if (of.length) await fetched("/table?log=" + l + "&of=" + of.slice(0, 40).join(",") + "&from=" + from + "&to=" + to);
    }
  });
  $("png").addEventListener("click", () => $("picture").toBlob((blob) => save(blob, (logs[shown ? shown.log : 0].name) + "-" + (shown ? shown.t : 0) + "s-seen.png")));
  $("png-raw").addEventListener("click", () => shown && fetched("/picture?log=" + shown.log + "&topic=" + ($("images").value || 0) + "&at=" + shown.at));
  $("copy").addEventListener("click", async () => {
    try { await navigator.clipboard.writeText($("window").textContent); put("reading", "copied"); } catch (e) {
      getSelection().selectAllChildren($("window"));
    }
  });

  // --- hands -------------------------------------------------------------------------------------------------------
  $("play").addEventListener("click", () => play(!playing));
  $("back").addEventListener("click", () => stepFrame(-1));
  $("forth").addEventListener("click", () => stepFrame(1));
  $("slider").addEventListener("input", () => { play(false); go(Number($("slider").value)); });
  $("begin").addEventListener("click", () => setRange(now, range && range[1] > now ? range[1] : last));
  $("end").addEventListener("click", () => setRange(range && range[0] < now ? range[0] : first, now));
  $("clear").addEventListener("click", () => setRange(0, 0));
  $("closer").addEventListener("click", () => range && look(range));
  $("whole").addEventListener("click", () => look([first, last]));
  $("add").addEventListener("click", () => {
    const f = fieldsListed[$("field").selectedIndex];
    if (!f) return;
    const k = Number($("into").value);
    if (k < 0 || !plots[k]) addPlot([f]); else addField(plots[k], f);
  });
  for (const id of ["stripe", "zoom"]) $(id).addEventListener("change", () => wantFrame({ t: now }));
  $("which").addEventListener("change", () => { listImages(); wantFrame({ t: now }); });
  $("images").addEventListener("change", () => wantFrame({ t: now }));
  document.addEventListener("keydown", (e) => {
    const on = e.target;
    if (e.ctrlKey || e.metaKey || e.altKey || on.tagName === "SELECT" || (on.tagName === "INPUT" && on.type === "text")) return;
    const own = on.tagName === "BUTTON" || on.tagName === "SUMMARY" || on.type === "checkbox";
    const far = (last - first) / 20;
    const does = {
      " ": own ? null : () => play(!playing), ArrowLeft: () => (e.shiftKey ? go(now - 1) : stepFrame(-1)), ArrowRight: () => (e.shiftKey ? go(now + 1) : stepFrame(1)),
      PageUp: () => go(now + far), PageDown: () => go(now - far), Home: () => go(first), End: () => go(last),
      "[": () => $("begin").click(), "]": () => $("end").click(), z: () => $("closer").click(), 0: () => $("whole").click(), s: () => $("zoom").click(),
    }[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    if (!does) return;
    e.preventDefault();
    does();
  });
  for (const other of ["(prefers-color-scheme: dark)", "print"]) matchMedia(other).addEventListener("change", () => {
    plots.forEach((p) => p.u.redraw(false, true));
    if (profile) profile.redraw(false, true);
  });

  // --- the beginning -----------------------------------------------------------------------------------------------
  let fieldsListed = [];
  const learn = async () => {
    const info = await (await ask("/info")).json();
    logs = info.logs;
    logs.forEach((log) => { log.numbers = new Map(log.fields.map((f) => [keyOf(f), f.number])); });
    const all = new Map();
    logs.forEach((log) => log.fields.forEach((f) => { if (!all.has(keyOf(f))) all.set(keyOf(f), f); }));
    // Stamps are the axis; nobody plots them.
    const isStamp = (f) => /(^|\.)(timestamp|stamp)\.(seconds|nanos|sec|nsec|nanosec)$/.test(f.path);
    fieldsListed = [...all.values()].filter((f) => !isStamp(f)).sort((a, b) => a.topic.localeCompare(b.topic));
    const box = $("field"), had = box.value;
    const groups = new Map();
    fieldsListed.forEach((f) => {
      if (!groups.has(f.topic)) { const g = make("optgroup"); g.label = f.topic; groups.set(f.topic, g); }
      const o = make("option", "", labelOf(f));
      o.value = keyOf(f);
      groups.get(f.topic).append(o);
    });
    box.replaceChildren(...groups.values());
    if (had) box.value = had;
    const notes = logs.flatMap((log) => log.notes.map((words) => (logs.length > 1 ? log.name + ": " : "") + words));
    if (!fieldsListed.length) notes.push("no number in it that could be plotted");
    show("notes", notes.length > 0);
    $("notes").replaceChildren(...notes.map((words) => make("li", "", words)));
    const undecoded = logs.flatMap((log) => log.undecoded);
    show("undecoded-box", undecoded.length > 0);
    put("undecoded-note", undecoded.length + " topic(s) whose messages are not read");
    $("undecoded").replaceChildren(...undecoded.map((u) => make("li", "", u.topic + " (" + (u.schema || "no schema") + ", " + u.messages + " messages): " + u.why)));
  };
  const listImages = () => {
    const log = logs[$("which").value || 0];
    const box = $("images");
    box.replaceChildren(...log.images.map((i, k) => { const o = make("option", "", i.topic); o.value = String(k); return o; }));
    show("images-box", log.images.length > 1);
  };
  const usual = () => {
    const of = (topic, wanted) => fieldsListed.filter((f) => f.topic === topic && wanted.includes(f.path));
    // Beside one log its model; several are compared with each other.
    const topics = [MOTION, ...(logs.every((log) => has(log, MOTION)) ? [] : [TRUTH]), ...(logs.length > 1 ? [] : [PREDICTED])];
    const motion = (wanted) => topics.flatMap((topic) => of(topic, wanted));
    const sets = [motion(["x_m", "y_m", "z_m"]), motion(["phi_rad", "theta_rad", "psi_rad"]), of("/thruster/command", ["thrust_n"]),
      logs.length > 1 ? [] : of(RESIDUAL, ["x_m", "y_m", "z_m"])];
    const some = sets.filter((s) => s.length);
    if (some.length) return some;
    // Anything but counters.
    return fieldsListed.filter((f) => !/(sequence|seq)$/.test(f.path)).slice(0, 3).map((f) => [f]);
  };
  const listEvents = async () => {
    for (let read = 0; read < 1;) {
      const found = [];
      read = 1;
      for (let l = 0; l < logs.length; l++) {
        const part = await (await ask("/events?log=" + l)).json();
        read = Math.min(read, part.read);
        found.push(...part.events.map((e) => ({ ...e, log: l })));
      }
      found.sort((a, b) => a.t_s - b.t_s);
      events.splice(0, events.length, ...found);
      show("event-box", found.length > 0);
      put("event-note", found.length ? found.length + " of " + (logs.length > 1 ? "all logs" : "the run") : "");
      $("events").replaceChildren(...found.map((e) => {
        const row = make("li", e.severity), button = make("button");
        button.type = "button";
        button.append(make("time", "", seconds(e.t_s)), make("span", "kind", e.kind), make("span", "words", e.message + (logs.length > 1 ? " (" + logs[e.log].name + ")" : "")));
        button.addEventListener("click", () => { play(false); go(e.t_s); });
        row.append(button);
        return row;
      }));
      plots.forEach((p) => p.u.redraw(false, false));
    }
  };
  (async () => {
    await learn();
    put("title", logs.map((log) => log.name).join(" · "));
    document.title = logs.map((log) => log.name).join(" · ") + " · hydroline view";
    const zeros = [...new Set(logs.map((log) => log.zero))];
    put("about", [...new Set(logs.map((log) => log.about).filter((a) => a))].join(" · ") + "  0 s = " + zeros.join(", ") + ", " + new Date(logs[0].zero_unix_ms).toISOString().replace("T", " ").slice(0, 19) + " UTC");
    first = Math.min(...logs.map((log) => log.from_s));
    last = Math.max(...logs.map((log) => log.to_s));
    if (!(last > first)) last = first + 1e-3;
    view = [first, last];
    $("slider").min = String(first);
    $("slider").max = String(last);
    $("which").replaceChildren(...logs.map((log, k) => { const o = make("option", "", log.name); o.value = String(k); return o; }));
    const withImages = logs.findIndex((log) => log.images.length);
    show("which-box", logs.filter((log) => log.images.length).length > 1);
    if (withImages >= 0) $("which").value = String(withImages);
    show("picture-box", withImages >= 0);
    listImages();
    listPlots();
    usual().forEach(addPlot);
    const named = logs.find((log) => log.window_s);
    const to = named && named.window_s[1] !== null ? named.window_s[1] + named.window_zero_s : last;
    if (named) setRange(named.window_s[0] + named.window_zero_s, to); else setRange(0, 0);
    go(named ? range[0] : Math.max(first, 0));
    await listEvents();
  })().catch(failed);
})();
