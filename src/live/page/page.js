(() => {
  const ask = (path, wait) => fetch(path, { headers, cache: "no-store", signal: AbortSignal.timeout(wait) });

  // --- words and numbers -------------------------------------------------------------------------------------------
  const num = (v, digits) => (v === null || v === undefined || !isFinite(v) ? "–" : v.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−"));
  const withUnit = (v, digits, unit) => (v === null || v === undefined ? "–" : num(v, digits) + " " + unit);
  const deg = 180 / Math.PI;
  // Name on the page, unit, factor, digits; sd and residual in their own finer unit.
  const channels = {
    x_m: ["x", "m", 1, 4, "mm", 1e3, 2], y_m: ["y", "m", 1, 4, "mm", 1e3, 2], z_m: ["z", "m", 1, 4, "mm", 1e3, 2],
    phi_rad: ["roll", "°", deg, 2, "°", deg, 3], theta_rad: ["pitch", "°", deg, 2, "°", deg, 3], psi_rad: ["yaw", "°", deg, 2, "°", deg, 3],
  };
  const clock = (s) => {
    const m = Math.floor(s / 60);
    return m + ":" + (s - 60 * m).toFixed(1).padStart(4, "0");
  };

  // --- plots -------------------------------------------------------------------------------------------------------
  const HISTORY_S = 60;
  const plots = [];
  const axis = (label, extra) => ({
    stroke: () => colour("soft"), grid: { stroke: () => colour("grid"), width: 1 }, ticks: { stroke: () => colour("grid"), width: 1 },
    font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", label, labelSize: label ? 18 : 0, ...extra,
  });
  const lineOf = (label, name, extra) => ({ label, stroke: () => colour(name), width: 1.5, points: { show: false }, ...extra });
  // Some air, and never a range so narrow that noise fills it.
  const around = (low, high, least) => {
    if (low === null) return [-least, least];
    const air = Math.max(0.08 * (high - low), 0.5 * (least - (high - low)), 0);
    return [low - air, high + air];
  };
  const plot = (id, series, xLabel, least) => {
    const box = $(id);
    const height = 190;
    const p = new uPlot({
      width: Math.max(box.clientWidth, 200), height, cursor: { drag: { x: false, y: false } },
      scales: { x: { time: false }, y: { range: (_, low, high) => around(low, high, least) } }, legend: { show: false }, axes: [axis(xLabel, {}), axis("", { size: 46 })], series: [{}, ...series],
    }, series.map(() => []).concat([[]]), box);
    plots.push([box, p]);
    new ResizeObserver(() => { if (box.clientWidth > 50 && box.clientWidth !== p.width) p.setSize({ width: box.clientWidth, height }); }).observe(box);
    return p;
  };
  const profile = plot("profile", [
    lineOf("stripe", "orange", { width: 0, points: { show: true, size: 3, fill: () => colour("orange"), stroke: () => colour("orange") } }),
    lineOf("floor and target", "blue", { spanGaps: false }),
  ], "", 0.02);
  let position = null, attitude = null, thrust = null;
  const residuals = { t: [], rows: [[], [], [], [], [], []] };
  const loads = { t: [], rows: [] };
  const forget = (h, now) => {
    let n = 0;
    while (n < h.t.length && h.t[n] < now - HISTORY_S) n++;
    if (n) { h.t.splice(0, n); h.rows.forEach((r) => r.splice(0, n)); }
  };
  const since = (h, now) => h.t.map((t) => t - now);
  for (const other of ["(prefers-color-scheme: dark)", "print"]) matchMedia(other).addEventListener("change", () => plots.forEach(([, p]) => p.redraw(false, true)));

  // --- the state ---------------------------------------------------------------------------------------------------
  let stopping = false, lastPoseAt = 0;
  const drawRun = (s) => {
    put("title", s.title);
    put("phase", s.phase);
    document.title = s.title + " · hydroline live";
    const r = s.run;
    const long = r.length_s ? " / " + clock(r.length_s) : "";
    put("elapsed", r.elapsed_s === null ? "" : clock(r.elapsed_s) + long);
    put("step", r.steps ? "step " + (r.step || "–") + " of " + r.steps : "");
    show("progress", r.elapsed_s !== null && !!r.length_s);
    if (r.length_s) $("done").style.width = Math.min(100, 100 * (r.elapsed_s || 0) / r.length_s) + "%";
    const button = $("stop");
    button.hidden = !s.stop.possible;
    button.classList.toggle("pressed", s.stop.pressed);
    if (s.stop.pressed) button.textContent = "STOPPED: neutral";
    else if (!stopping) button.textContent = "STOP";
  };
  const drawPose = (s) => {
    show("pose-box", !!s.pose);
    if (!s.pose) return;
    put("pose-kind", s.pose.kind);
    put("pose-note", s.pose.age_s < 2 ? "" : "last one " + num(s.pose.age_s, 0) + " s ago");
    const body = $("pose");
    while (body.rows.length < s.pose.channels.length) {
      const row = body.insertRow();
      row.append(make("th"));
      for (let i = 0; i < 4; i++) row.insertCell();
    }
    let any = false;
    s.pose.channels.forEach((c, i) => {
      const [name, unit, factor, digits, fine, fineFactor, fineDigits] = channels[c.name];
      const cells = body.rows[i].cells;
      const of = (v, f) => (v === null ? null : v * f);
      const words = [name, withUnit(of(c.value, factor), digits, unit), withUnit(of(c.sd, fineFactor), fineDigits, fine),
        withUnit(of(c.predicted, factor), digits, unit), withUnit(of(c.residual, fineFactor), fineDigits, fine)];
      words.forEach((w, k) => { if (cells[k].textContent !== w) cells[k].textContent = w; });
      any = any || c.residual !== null;
    });
    if (any && s.pose.at_s > lastPoseAt) {
      residuals.t.push(s.pose.at_s);
      s.pose.channels.forEach((c, i) => residuals.rows[i].push(c.residual === null ? null : c.residual * (i < 3 ? 1e3 : deg)));
      lastPoseAt = s.pose.at_s;
      forget(residuals, lastPoseAt);
    }
    if (residuals.t.length > 1) {
      show("position-box", true);
      show("attitude-box", true);
      const names = ["blue", "orange", "green"];
      position = position || plot("position", ["x", "y", "z"].map((n, i) => lineOf(n, names[i])), "s before the newest", 2);
      attitude = attitude || plot("attitude", ["roll", "pitch", "yaw"].map((n, i) => lineOf(n, names[i])), "s before the newest", 0.2);
      position.setData([since(residuals, lastPoseAt), ...residuals.rows.slice(0, 3)]);
      attitude.setData([since(residuals, lastPoseAt), ...residuals.rows.slice(3)]);
    }
  };
  const drawLoads = (s, now) => {
    show("load-box", s.thrusters.length > 0);
    if (!s.thrusters.length) return;
    const box = $("loads");
    while (box.children.length < s.thrusters.length) {
      const row = make("div", "load");
      const bar = make("div", "bar");
      bar.append(make("i", "sent"), make("i", "zero"), make("i", "heard"));
      row.append(make("span", "name"), bar, make("span", "number"), make("span", "number echo"));
      box.append(row);
    }
    s.thrusters.forEach((t, i) => {
      const [name, bar, sent, heard] = box.children[i].children;
      name.textContent = t.name;
      name.title = t.name + (t.pulse_us === null ? "" : ", " + num(t.pulse_us, 1) + " µs sent, " + num(t.echo_us, 1) + " µs echoed");
      sent.textContent = num(t.thrust_n, 2);
      heard.textContent = num(t.echo_n, 2);
      const [low, high] = t.range_n;
      const at = (v) => 100 * (Math.min(high, Math.max(low, v)) - low) / (high - low || 1);
      const [fill, zero, mark] = bar.children;
      zero.style.left = at(0) + "%";
      const v = t.thrust_n || 0;
      fill.style.left = Math.min(at(0), at(v)) + "%";
      fill.style.width = Math.abs(at(v) - at(0)) + "%";
      mark.style.left = at(t.echo_n || 0) + "%";
      mark.style.display = t.echo_n === null ? "none" : "";
    });
    const n = s.thrusters.length;
    if (loads.rows.length !== 2 * n) { loads.t = []; loads.rows = Array.from({ length: 2 * n }, () => []); }
    loads.t.push(now);
    s.thrusters.forEach((t, i) => { loads.rows[i].push(t.thrust_n); loads.rows[n + i].push(t.echo_n); });
    forget(loads, now);
    show("thrust-box", true);
    const names = ["blue", "orange", "green", "purple"];
    thrust = thrust || plot("thrust", s.thrusters.map((t, i) => lineOf(t.name, names[i % 4]))
      .concat(s.thrusters.map((t, i) => lineOf(t.name + " echoed", names[i % 4], { dash: [4, 4] }))), "s before now", 2);
    thrust.setData([since(loads, now), ...loads.rows]);
  };
  const list = (id, items, row) => {
    const text = JSON.stringify(items);
    const e = $(id);
    if (e.dataset.text === text) return;
    e.dataset.text = text;
    e.replaceChildren(...items.map(row));
  };
  const drawAccount = (s) => {
    const f = s.frames;
    const rows = [["frames received", String(f.received)], ["lost by the camera", String(f.lost)], ["dropped by the log", String(f.dropped)],
      ["not analysed live", String(f.skipped)], ["frames per second", num(f.rate_fps, 1)], ["stripe points", String(f.points)]];
    if (s.clock) rows.push(["controller's clock", "± " + num(s.clock.offset_sd_us, 0) + " µs, drift " + num(s.clock.drift_ppm, 1) + " ppm"], ["round trip", num(s.clock.round_trip_us / 1e3, 2) + " ms"]);
    if (s.disk && s.disk.bytes > 0) rows.push(["log", num(s.disk.bytes / 1e6, 1) + " MB"]);
    if (s.disk) rows.push(["disk left for", s.disk.left_min === null ? "–" : num(s.disk.left_min, 0) + " min"]);
    list("account", rows.flat(), (text, i) => make(i % 2 ? "dd" : "dt", (i === 3 || i === 5) && text !== "0" ? "bad" : "", text));
  };
  const drawWords = (s) => {
    show("aim-box", s.aim.length > 0);
    list("aim", s.aim, (c) => {
      const row = make("li");
      const cls = c.good === null ? "" : c.good ? "good" : "bad";
      row.append(make("span", "mark " + cls, c.good === null ? "?" : c.good ? "✓" : "✗"), make("span", "", c.what), make("span", cls, c.words));
      return row;
    });
    show("missing-box", s.not_shown.length > 0);
    list("missing", s.not_shown, (words) => make("li", "", words));
    if (!s.events.length) return;
    list("events", s.events.slice().reverse(), (e) => {
      const row = make("li", e.severity);
      row.append(make("time", "", new Date(1e3 * e.at_s).toTimeString().slice(0, 8)), make("span", "kind", e.kind), make("span", "words", e.message));
      return row;
    });
  };
  const draw = (s) => {
    drawRun(s);
    drawPose(s);
    drawLoads(s, performance.now() / 1e3);
    drawAccount(s);
    drawWords(s);
  };

  // --- the picture -------------------------------------------------------------------------------------------------
  const trace = (pen, points) => {
    pen.beginPath();
    let up = true;
    for (const p of points) {
      if (!p) { up = true; continue; }
      if (up) pen.moveTo(p[0] + 0.5, p[1] + 0.5); else pen.lineTo(p[0] + 0.5, p[1] + 0.5);
      up = false;
    }
    pen.stroke();
  };
  const drawPicture = (bitmap, o) => {
    const canvas = $("picture");
    if (canvas.width !== o.width_px || canvas.height !== o.height_px) { canvas.width = o.width_px; canvas.height = o.height_px; }
    const pen = canvas.getContext("2d");
    if (bitmap) pen.drawImage(bitmap, 0, 0, o.width_px, o.height_px);
    else { pen.fillStyle = "#000"; pen.fillRect(0, 0, o.width_px, o.height_px); }
    const thick = Math.max(1, o.width_px / 500);
    pen.lineWidth = thick;
    pen.strokeStyle = "#56b4e9";
    trace(pen, o.outline_px);
    pen.fillStyle = "#f0e442";
    for (const [x, y] of o.stripe_px) pen.fillRect(x + 0.5 - thick / 2, y + 0.5 - thick / 2, thick, thick);
    show("no-picture", false);
    show("outline-key", o.outline_px.length > 0);
    put("picture-note", (o.fault ? o.fault + " · " : "") + "frame " + o.sequence);
    drawProfile(o);
  };
  const drawProfile = (o) => {
    // One ascending axis for both: measured points, and the expected line where it stands.
    const rows = o.profile_m.map(([x, y]) => [x, y, undefined]).concat(o.expected_m.filter((p) => p).map(([x, y]) => [x, undefined, y]));
    rows.sort((a, b) => a[0] - b[0]);
    profile.setData([0, 1, 2].map((k) => rows.map((r) => r[k])));
  };

  // --- asking, for ever --------------------------------------------------------------------------------------------
  const lost = (why) => {
    put("gone", why);
    show("gone", !!why);
  };
  const forever = async (once) => {
    for (;;) {
      try { await once(); } catch (e) { await pause(500); }
    }
  };
  const refused = async (answer) => {
    if (answer.ok) return false;
    lost((await answer.text()).trim());
    await pause(2000);
    return true;
  };
  let stateNumber = 0, pictureNumber = 0, heardAt = 0, ended = false;
  forever(async () => {
    let answer;
    try { answer = await ask("/state?after=" + stateNumber, 5000); } catch (e) {
      if (ended) lost("The run is over; this is its last state.");
      else if (performance.now() - heardAt > 2000) lost("No answer from hydroline: what is shown is old" + ($("stop").hidden ? "." : ", and STOP does not work from here."));
      throw e;
    }
    heardAt = performance.now();
    if (await refused(answer)) return;
    lost("");
    if (answer.status !== 200) return;
    const { number, state } = await answer.json();
    stateNumber = number;
    ended = state.ended;
    draw(state);
  });
  forever(async () => {
    if (document.hidden) { await pause(300); return; }
    const answer = await ask("/picture?after=" + pictureNumber, 5000);
    if (!answer.ok) { await pause(1000); return; }
    if (answer.status !== 200) return;
    pictureNumber = Number(answer.headers.get("x-number"));
    const bytes = await answer.arrayBuffer();
    const length = new DataView(bytes).getUint32(0, true);
    const overlay = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
    const jpeg = new Uint8Array(bytes, 4 + length);
    const bitmap = jpeg.length ? await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })) : null;
    drawPicture(bitmap, overlay);
    if (bitmap) bitmap.close();
  });

  $("stop").addEventListener("click", async () => {
    stopping = true;
    $("stop").textContent = "stopping …";
    try {
      const answer = await fetch("/stop", { method: "POST", headers, signal: AbortSignal.timeout(3000) });
      if (answer.status === 403) location.reload();
      else if (!answer.ok) lost((await answer.text()).trim());
    } catch (e) {
      lost("STOP got no answer: press Space or Ctrl-C at hydroline's terminal, or cut the power.");
    }
    stopping = false;
  });
})();
