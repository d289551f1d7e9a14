// The state as tables. Everything that comes from the pipeline is set as text, never as HTML.
export const of = id => document.getElementById(id);
export const number = (value, digits) => typeof value === "number" ? value.toFixed(digits) : "-";
export const element = (name, text, kind) => {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
};
// A column: heading, value of a row, and the number of decimals where it is a number.
const table = (id, rows, columns) => {
  of(id).closest("section").hidden = rows.length === 0;
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

export const show = top => {
  of("title").textContent = top.pipeline;
  document.title = `${top.troubles.length ? `(${top.troubles.length}) ` : ""}${top.pipeline}`;
  if (top.troubles.length) list("troubles", "li", top.troubles, "bad");
  else list("troubles", "li", ["none"], "good");
  of("state").closest("section").hidden = top.state.length === 0;
  list("state", "p", top.state, "state");
  table("paths", top.paths, [
    ["path", p => `${p.from} > ${p.to}`], ["arrived", p => p.arrived, 0], ["of", p => p.samples, 0],
    ["p50 ms", p => p.total_ms.p50, 1], ["p90", p => p.total_ms.p90, 1], ["p99", p => p.total_ms.p99, 1],
    ["worst", p => p.total_ms.max, 1], ["to blame for the longest", p => p.blame]]);
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
  table("ledger", top.ledger, [
    ["topic", l => l.topic], ["input", l => l.consumer], ["sent", l => l.sent, 0], ["received", l => l.received, 0],
    ["passed", l => l.passed, 0], ["overwritten", l => l.overwritten, 0], ["no memory", l => l.pool_exhausted, 0],
    ["down", l => l.down, 0], ["waiting", l => l.left, 0]]);
  table("log", top.log.slice(-40).reverse(), [
    ["s", l => l.t, 1], ["level", l => l.level], ["operator", l => l.operator], ["message", l => l.message]]);
};
