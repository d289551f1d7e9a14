"use strict";
// Everything that comes from the pipeline is set as text, never as HTML.
const of = id => document.getElementById(id);
const number = (value, digits) => typeof value === "number" ? value.toFixed(digits) : "-";
const element = (name, text, kind) => {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
};
// A column: heading, value of a row, and the number of decimals where it is a number.
const table = (id, rows, columns) => {
  const head = document.createElement("tr");
  for (const [name, , digits] of columns) head.append(element("th", name, digits === undefined ? "" : "number"));
  const body = rows.map(row => {
    const line = document.createElement("tr");
    for (const [, value, digits] of columns) {
      const text = digits === undefined ? String(value(row) ?? "-") : number(value(row), digits);
      line.append(element("td", text, digits === undefined ? "" : "number"));
    }
    return line;
  });
  of(id).replaceChildren(head, ...body);
};
const list = (id, name, texts, kind) => of(id).replaceChildren(...texts.map(text => element(name, text, kind)));
let drawn = 0;
const show = top => {
  of("title").textContent = top.pipeline;
  document.title = `${top.troubles.length ? `(${top.troubles.length}) ` : ""}${top.pipeline}`;
  of("about").textContent = `over ${number(top.seconds, 1)} s`;
  if (top.troubles.length) list("troubles", "li", top.troubles, "bad");
  else list("troubles", "li", ["none"], "good");
  const words = [...top.state];
  list("state", "p", words, "state");
  table("operators", top.operators, [
    ["operator", o => o.operator], ["state", o => o.state], ["Hz", o => o.rate_hz, 1],
    ["step p50 ms", o => o.step_ms[0], 2], ["p99", o => o.step_ms[1], 2], ["age ms", o => o.age_ms[0], 1],
    ["missed", o => o.missed, 0], ["lost", o => o.lost, 0], ["errors", o => o.errors + o.panics, 0],
    ["restarts", o => o.restarts, 0], ["CPU %", o => o.cpu_percent, 0], ["process", o => o.process]]);
  table("edges", top.edges.filter(e => e.taken + e.lost > 0), [
    ["edge", e => `${e.topic} > ${e.to}`], ["Hz", e => e.rate_hz, 1], ["latency ms", e => e.latency_ms.p50, 2],
    ["p99", e => e.latency_ms.p99, 2], ["age ms", e => e.age_ms.p50, 1], ["passed", e => e.passed, 0],
    ["lost", e => e.lost, 0]]);
  table("contracts", top.contracts, [
    ["contract", c => c.contract], ["", c => c.is_broken ? "BROKEN" : "kept"],
    ["kept %", c => c.kept === null ? null : 100 * c.kept, 1], ["needed %", c => 100 * c.needed, 1],
    ["worst ms", c => c.worst_ms, 1]]);
  table("processes", top.processes, [
    ["process", p => p.name], ["PID", p => p.pid, 0], ["CPU %", p => p.cpu_percent, 0],
    ["without a core %", p => p.delayed_percent, 1], ["MB", p => p.memory_bytes / 1e6, 0],
    ["priority", p => p.granted], ["cores", p => p.cores]]);
  if (drawn++ % 4 === 0) of("graph").src = `graph.svg?${drawn}`;
};
const events = new EventSource("events");
events.onmessage = message => show(JSON.parse(message.data));
events.addEventListener("end", () => { events.close(); of("about").textContent += ", the run has ended"; });
events.onerror = () => { of("about").textContent = "no connection"; };
