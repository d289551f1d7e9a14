//! What runs, its topics and their rates, and its end from outside, of live runs and of their sessions.

use serde_json::Value;

use crate::bench::{Bench, pipeline, text};

/// The row of a topic.
fn row<'v>(value: &'v Value, topic: &str) -> &'v Value {
    let rows = value["topics"].as_array().unwrap();
    rows.iter().find(|r| r["topic"] == topic).unwrap_or_else(|| panic!("{topic}: {value}"))
}

#[test]
fn runs_are_listed_with_pipeline_age_state_and_session() {
    let bench = Bench::new();
    assert_eq!(bench.call(&["ps", "--json"]).good()["runs"], serde_json::json!([]));
    assert!(bench.call(&["ps"]).out.contains("no pipeline is running"));
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let found = bench.call(&["ps", "--json"]).good();
    let listed = &found["runs"][0];
    assert_eq!((&listed["pipeline"], &listed["state"]), (&"chain".into(), &"running".into()), "{found}");
    assert_eq!(listed["run"], run.pid());
    assert!(listed["age_s"].as_f64().unwrap() > 0.0, "{found}");
    assert!(listed["session"].as_str().unwrap().ends_with("chain-0001"), "{found}");
    let shown = bench.call(&["ps"]).out;
    assert!(shown.contains("chain") && shown.contains("running"), "{shown}");
    // The supervisor alone is stopped.
    crate::bench::signal(run.pid(), rustix::process::Signal::STOP);
    let suspended = bench.call(&["ps", "--json"]).good();
    crate::bench::signal(run.pid(), rustix::process::Signal::CONT);
    assert_eq!(suspended["runs"][0]["state"], "suspended", "{suspended}");
    run.stop().good();
}

#[test]
fn topics_and_rates_of_a_run_and_of_its_session_have_one_shape() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let topics = bench.call(&["topics", "--json"]).good();
    let value = row(&topics, "source.value");
    assert_eq!(value["consumers"], serde_json::json!(["middle", "sink"]), "{topics}");
    assert_eq!(topics["of"]["run"], run.pid());
    assert!(value["rate_hz"].as_f64().unwrap() > 0.0 && value["bytes"].as_u64().unwrap() > 32, "{topics}");
    let rates = bench.call(&["hz", "source.value", "--for", "500 ms", "--json"]).good();
    assert_eq!(rates["topics"].as_array().unwrap().len(), 1, "{rates}");
    let measured = row(&rates, "source.value");
    assert!(measured["samples"].as_u64().unwrap() > 2, "{rates}");
    assert!(measured["interval_ms"]["jitter"].as_f64().unwrap() >= 0.0, "{rates}");
    let unknown = bench.call(&["hz", "source.valeu"]);
    assert!(unknown.code() == 2 && unknown.err.contains("did you mean source.value?"), "{}", unknown.err);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let recorded = bench.call(&["topics", "--session", session, "--json"]).good();
    let repeated = row(&recorded, "source.value");
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(repeated), keys(value));
    assert_eq!((&repeated["consumers"], &repeated["type"]), (&value["consumers"], &value["type"]));
    let sent = crate::bench::figures(&report, "source")["sent"].as_u64().unwrap();
    let rates = bench.call(&["hz", "--session", session, "--json"]).good();
    assert_eq!(row(&rates, "source.value")["samples"], sent);
    bench.call(&["replay", session, "--json"]).good();
}

#[test]
fn a_run_that_is_stopped_from_outside_ends_in_order() {
    let bench = Bench::new();
    let nobody = bench.call(&["stop"]);
    assert!(nobody.code() == 1 && nobody.err.contains("no pipeline is running"), "{}", nobody.err);
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let stopped = bench.call(&["stop", "--run", "chain", "--json"]).good();
    assert_eq!(stopped["run"], run.pid(), "{stopped}");
    // The run ended as by Ctrl-C: its session is whole.
    let report = run.finish().good();
    assert_eq!(report["ended_early"], "stopped", "{report}");
    assert_eq!(stopped["session"].as_str().map(|s| s.ends_with("chain-0001")), Some(true), "{stopped}");
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
}

#[test]
fn samples_are_shown_in_words_by_path_and_as_json() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("console.yaml"));
    bench.wait_for_samples("after.sum", 2);
    assert_eq!(bench.call(&["send", "console.arm"]).code(), 0);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let screen = bench.call(&["echo", "console.arm", "--session", session]);
    assert!(screen.out.lines().any(|l| l.split_whitespace().eq(["verb", "arm"])), "{}", screen.out);
    let path = bench.call(&["echo", "console.arm", "verb", "values[1]", "--session", session]);
    assert_eq!(path.out, "verb: arm   values[1]: 0\n");
    let json = bench.call(&["echo", "console.arm", "verb", "--json", "--session", session]);
    let value: Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!((&value["verb"], &value["words"]["verb"]), (&1.into(), &serde_json::json!(["arm"])));
    let wrong = bench.call(&["echo", "console.arm", "values[9]", "--session", session]);
    assert!(wrong.code() == 2 && wrong.err.contains("(allowed: 0 to 5)"), "{}", wrong.err);
    let journal = bench.call(&["echo", "console.journal", "cause", "--count", "1", "--session", session]);
    assert_eq!(journal.out, "cause: start\n");
    assert!(text(std::path::Path::new(session)).contains("console-0001"));
}

#[test]
fn a_log_of_a_run_and_of_its_session_has_what_operators_say_and_what_happens_to_processes() {
    let bench = Bench::new();
    let written = std::fs::read_to_string(pipeline("chain.yaml")).unwrap();
    let file = bench.path("talks.yaml");
    let habit = "source: { use: kit.outside, every: 2 ms, params: { habit: log, at: 100 } }";
    std::fs::write(&file, written.replace("source: { use: kit.outside, every: 2 ms }", habit)).unwrap();
    let run = bench.run(&file);
    let lines = |arguments: &[&str]| {
        let done = bench.call(&[&["log", "--json"], arguments].concat());
        let all = done.out.lines().map(|l| serde_json::from_str::<Value>(l).unwrap());
        all.collect::<Vec<_>>()
    };
    let has_text = |line: &Value| line["operator"] == "source" && line["level"] == "warn";
    let output_text =
        crate::bench::wait_for("a line of the source", || lines(&[]).into_iter().find(has_text));
    assert_eq!(output_text["message"], "the kit warns index=100", "{output_text}");
    // A process that is killed is said to have ended, and to start again.
    let top = bench.call(&["top", "--once", "--for", "100 ms", "--json"]).good();
    let middle = top["processes"].as_array().unwrap().iter().find(|p| p["name"] == "middle").unwrap();
    crate::bench::signal(middle["pid"].as_u64().unwrap() as u32, rustix::process::Signal::KILL);
    let repeated = |line: &Value| {
        line["operator"] == "middle" && line["message"].as_str().unwrap().starts_with("starts again")
    };
    crate::bench::wait_for("the restart", || lines(&["--level", "warn"]).into_iter().find(repeated));
    let report = run.stop().json();
    let session = report["session"].as_str().unwrap();
    let retained = lines(&[session]);
    let of = |operator: &str| retained.iter().filter(|l| l["operator"] == operator).collect::<Vec<_>>();
    assert!(of("source").iter().any(|l| has_text(l)), "{retained:?}");
    assert!(of("middle").iter().any(|l| l["level"] == "error"), "{retained:?}");
    let begun = of("sink")[0]["message"].as_str().unwrap();
    assert!(begun.starts_with("runs as process ") && begun.ends_with("scheduled as normal"), "{begun}");
    assert_eq!(retained.last().unwrap()["message"], "the run ends: stopped");
    let errors = lines(&[session, "--level", "error", "--operator", "middle"]);
    assert!(!errors.is_empty() && errors.iter().all(|l| l["level"] == "error"), "{errors:?}");
    let simulated = ["run", text(&file), "--clock", "simulated", "--for", "20 ms", "--json"];
    let simulated = bench.call(&simulated).good();
    let none = bench.call(&["log", simulated["session"].as_str().unwrap()]);
    assert!(none.code() == 1 && none.err.contains("it keeps no log"), "{}", none.err);
}

#[test]
fn the_figures_of_a_run_are_served_to_prometheus() {
    let bench = Bench::new();
    let run = bench.start(&["run", text(&pipeline("chain.yaml")), "--metrics", "127.0.0.1:0", "--json"]);
    let address = crate::bench::wait_for("the address", || {
        let output_text = run.errors();
        Some(output_text.split("http://").nth(1)?.split("/metrics").next()?.to_owned())
    });
    let value = crate::bench::wait_for("a figure", || {
        let answer = ask(&address, "GET /metrics HTTP/1.1\r\n\r\n", "");
        let line = "stillpoint_samples_sent_total{pipeline=\"chain\",operator=\"source\"} ";
        answer.lines().find_map(|l| l.strip_prefix(line)?.parse::<u64>().ok())
    });
    assert!(value > 0);
    run.stop().good();
    let file = pipeline("chain.yaml");
    let simulated = ["run", text(&file), "--metrics", "127.0.0.1:0", "--clock", "simulated"];
    let refused = bench.call(&simulated);
    assert!(refused.code() == 2 && refused.err.contains("--metrics serves"), "{}", refused.err);
}

#[test]
fn doctor_names_each_setting_with_what_is_wanted_and_what_dead_runs_left() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    let doctor = |arguments: &[&str]| {
        bench.call(&[&["doctor", text(&file), "--for", "200 ms", "--json"], arguments].concat())
    };
    let found = doctor(&[]);
    let value = found.json();
    let findings = value["findings"].as_array().unwrap().clone();
    for setting in [
        "real-time priority",
        "wake-up of a thread",
        "shared memory",
        "clock source",
        "leftovers of dead runs",
    ] {
        let finding =
            findings.iter().find(|f| f["setting"] == setting).unwrap_or_else(|| panic!("{setting}"));
        assert!(
            !finding["found"].as_str().unwrap().is_empty() && finding["requested"].is_string(),
            "{finding}"
        );
    }
    // The exit code is the worst of what was found.
    let worst = match value["verdict"].as_str().unwrap() {
        "good" => 0,
        "unknown" => 1,
        _ => 2,
    };
    assert_eq!(found.code(), worst, "{value}");
    for finding in &findings {
        assert!(finding["verdict"] != "bad" || worst == 2, "{finding}");
        assert!(
            finding["verdict"] == "good" || finding["verdict"] == "unknown" || finding["mend"] != "",
            "{finding}"
        );
    }
    // A run whose supervisor is killed leaves its folder.
    let run = bench.run(&file);
    bench.wait_for_samples("sink.sum", 1);
    crate::bench::signal(run.pid(), rustix::process::Signal::KILL);
    run.finish();
    let leftovers = |value: &Value| {
        let all = value["findings"].as_array().unwrap();
        all.iter().find(|f| f["setting"] == "leftovers of dead runs").unwrap()["found"].clone()
    };
    let id = bench.run_ids();
    assert_eq!(leftovers(&doctor(&[]).json()), id[0].as_str());
    crate::bench::wait_for("the end of its processes", || {
        let cleaned = doctor(&["--clean"]).json();
        (cleaned["cleaned"][0] == id[0].as_str()).then_some(())
    });
    assert_eq!(leftovers(&doctor(&[]).json()), "none");
}

#[test]
fn faults_that_are_planted_in_a_run_are_named_from_the_outside() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("planted.yaml"));
    bench.wait_for_samples("well.sum", 2);
    // Until the camera has stalled and something has panicked.
    crate::bench::wait_for("the last sample of the camera", || {
        let top = bench.call(&["top", "--once", "--for", "500 ms", "--json"]).good();
        let troubles: Vec<String> = serde_json::from_value(top["troubles"].clone()).unwrap();
        let is_named =
            |start: &str, end: &str| troubles.iter().any(|t| t.starts_with(start) && t.contains(end));
        let all = [
            is_named("slow: missed ", "a step takes"),
            is_named("source.value -> lossy: ", "samples lost"),
            is_named("camera.value: camera sent nothing in", ""),
            is_named("fails: ", "activations failed"),
            is_named("panics: restarted", "times"),
        ];
        // What is well is not named, except where the machine is too busy for it.
        assert!(!is_named("well: ", ""), "{troubles:?}");
        all.iter().all(|named| *named).then_some(())
    });
    run.stop();
}

/// One request to a page of this machine, and the answer up to its end or to these words.
fn ask(address: &str, request: &str, until: &str) -> String {
    use std::io::{Read, Write};
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let (mut answer, mut piece) = (Vec::new(), [0; 4096]);
    loop {
        let count = stream.read(&mut piece).unwrap();
        answer.extend_from_slice(&piece[..count]);
        let text = String::from_utf8_lossy(&answer).into_owned();
        if count == 0 || (!until.is_empty() && text.contains(until)) {
            return text;
        }
    }
}

#[test]
fn a_page_of_a_run_shows_what_top_shows_follows_it_and_takes_no_commands() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let page = bench.start(&["view", "--port", "0", "--for", "500 ms"]);
    let address = crate::bench::wait_for("the address", || {
        let output_text = page.output_text();
        Some(output_text.split("http://").nth(1)?.split('/').next()?.to_owned())
    });
    let get = |path: &str| ask(&address, &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n"), "");
    let html = get("/");
    assert!(html.starts_with("HTTP/1.1 200 OK") && html.contains("src=\"page.js\"></script>"), "{html}");
    assert!(html.contains("Content-Security-Policy: default-src 'self'"), "{html}");
    assert!(get("/page.js").contains("new EventSource(\"events\")"));
    for file in ["page.css", "tables.js", "charts.js", "head.js", "commands.js"] {
        assert!(get(&format!("/{file}")).starts_with("HTTP/1.1 200 OK"), "{file}");
    }
    let body = |answer: &str| answer.split_once("\r\n\r\n").unwrap().1.to_owned();
    let state: Value = serde_json::from_str(&body(&get("/state.json"))).unwrap();
    let top = bench.call(&["top", "--once", "--for", "100 ms", "--json"]).good();
    for key in top.as_object().unwrap().keys() {
        assert!(!state[key].is_null() || top[key].is_null(), "{key}: {state}");
    }
    // What the script reads is there.
    assert!(state["state"].is_array() && state["operators"][0]["step_ms"].is_array(), "{state}");
    assert!(body(&get("/graph.svg")).starts_with("<svg xmlns="));
    // A client that reads nothing holds nobody up: others get one state after another.
    let stalled = std::net::TcpStream::connect(&address).unwrap();
    std::io::Write::write_all(&mut &stalled, b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let request = "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let mut streamed = ask(&address, request, "}\n\ndata: ");
    assert!(streamed.contains("text/event-stream"), "{streamed}");
    streamed = body(&streamed);
    let first = streamed.split("\n\n").next().unwrap().strip_prefix("data: ").unwrap().to_owned();
    assert_eq!(serde_json::from_str::<Value>(&first).unwrap()["pipeline"], "chain");
    // Another site cannot read it by a name of its own, and nobody can change anything.
    let foreign = ask(&address, "GET /state.json HTTP/1.1\r\nHost: evil.example\r\n\r\n", "");
    assert!(foreign.starts_with("HTTP/1.1 403"), "{foreign}");
    let post = ask(&address, "POST /state.json HTTP/1.1\r\nHost: localhost\r\n\r\n", "");
    assert!(post.starts_with("HTTP/1.1 405"), "{post}");
    run.stop().good();
    assert_eq!(page.finish().code(), 0);
}

/// Checks a trace by the rules of the Trace Event Format: what each event needs, slices of a thread one after another or
/// within each other, and arrows whose ends are within slices. Gives the number of slices and of arrows.
fn check_trace_events(file: &std::path::Path) -> (usize, usize) {
    use std::collections::BTreeMap;
    let trace: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let mut slices: BTreeMap<(u64, u64), Vec<(f64, f64)>> = BTreeMap::new();
    let (mut starts, mut ends) = (BTreeMap::new(), BTreeMap::new());
    let mut threads = std::collections::BTreeSet::new();
    for event in events {
        let thread = (event["pid"].as_u64().unwrap(), event["tid"].as_u64().unwrap());
        assert!(event["name"].is_string(), "{event}");
        let ts = || event["ts"].as_f64().filter(|t| *t >= 0.0).unwrap_or_else(|| panic!("{event}"));
        match event["ph"].as_str().unwrap() {
            "M" => {
                assert!(event["args"]["name"].is_string(), "{event}");
                threads.insert(thread);
            }
            "X" => {
                let length = event["dur"].as_f64().filter(|d| *d >= 0.0).unwrap_or_else(|| panic!("{event}"));
                slices.entry(thread).or_default().push((ts(), ts() + length));
            }
            "s" => assert!(starts.insert(event["id"].as_u64().unwrap(), (thread, ts())).is_none(), "{event}"),
            "f" => {
                assert_eq!(event["bp"], "e", "{event}");
                assert!(ends.insert(event["id"].as_u64().unwrap(), (thread, ts())).is_none(), "{event}");
            }
            other => panic!("{other}: {event}"),
        }
    }
    for (thread, slices) in &mut slices {
        assert!(threads.contains(thread), "thread {thread:?} has no name");
        slices.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        let mut open: Vec<f64> = Vec::new();
        for (start, end) in slices {
            open.retain(|e| *e > *start + 1e-6);
            assert!(open.iter().all(|e| *end <= e + 1e-3), "{thread:?}: {start} to {end} overlaps");
            open.push(*end);
        }
    }
    assert_eq!(starts.keys().collect::<Vec<_>>(), ends.keys().collect::<Vec<_>>());
    for (thread, ts) in starts.values().chain(ends.values()) {
        assert!(slices[thread].iter().any(|(a, b)| a - 1e-6 <= *ts && *ts <= b + 1e-6), "{thread:?} {ts}");
    }
    for (id, (_, start)) in &starts {
        assert!(ends[id].1 >= *start, "arrow {id} goes back");
    }
    (slices.values().map(Vec::len).sum(), starts.len())
}

#[test]
fn a_trace_of_a_run_and_of_its_session_names_paths_hops_and_blame() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let live = bench.call(&["trace", "chain", "--for", "500 ms", "--json"]).good();
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let file = bench.path("trace.json");
    let recorded = bench.call(&["trace", session, "--perfetto", text(&file), "--json"]).good();
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    for trace in [&live, &recorded] {
        let paths = trace["paths"].as_array().unwrap();
        let path = paths.iter().find(|p| p["path"] == "source.value -> middle.sum -> sink").unwrap();
        assert!(path["arrived"].as_u64().unwrap() > 2, "{path}");
        assert_eq!(path["operators"], serde_json::json!(["source", "middle", "sink"]));
        let total = |q: &str| path["total_ms"][q].as_f64().unwrap();
        assert!(total("p50") <= total("p90") && total("p99") <= total("max") && total("p50") > 0.0, "{path}");
        assert!(!path["blame"].as_array().unwrap().is_empty() && path["worst"].as_array().unwrap().len() > 2);
        assert_eq!(keys(path), keys(&live["paths"][0]));
    }
    assert_eq!(live["of"]["run"].as_u64().is_some(), recorded["of"]["session"].is_string());
    // The kernel counts how long each process waited for a core; a session has no such count.
    let delays = live["processes"].as_array().unwrap();
    for process in ["source", "middle", "sink"] {
        let delay =
            delays.iter().find(|d| d["process"] == process).unwrap_or_else(|| panic!("{process}: {live}"));
        assert!(delay["delayed_ms"].as_f64().unwrap() >= 0.0 && delay["seconds"].as_f64().unwrap() >= 0.5);
    }
    assert!(recorded["processes"].is_null(), "{}", recorded["processes"]);
    let (slices, arrows) = check_trace_events(&file);
    let done: u64 =
        report["operators"].as_array().unwrap().iter().map(|o| o["activations"].as_u64().unwrap()).sum();
    // The last activation of each operator has no end in the journal.
    assert!(slices as u64 + 3 >= done && slices as u64 <= done && arrows > 2, "{slices} of {done}, {arrows}");
    let shown = bench.call(&["trace", session, "--to", "sink"]);
    assert!(shown.out.contains("to blame for the 10 longest"), "{}{}", shown.out, shown.err);
    let nowhere = bench.call(&["trace", session, "--from", "sink.sum"]);
    assert!(nowhere.code() == 2 && nowhere.err.contains("there is no path from sink.sum"), "{}", nowhere.err);
    let page = bench.path("page.html");
    bench.call(&["report", session, "--out", text(&page)]);
    let page = std::fs::read_to_string(page).unwrap();
    assert!(
        page.contains("From source to sink") && page.contains("source.value -&gt; middle.sum -&gt; sink")
    );
}

#[test]
fn a_graph_of_a_file_a_run_and_a_session_has_the_same_edges_and_measures_where_it_can() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    let drawn = |arguments: &[&str]| bench.call(&[&["graph"], arguments].concat());
    let before = drawn(&[text(&file), "--json"]).good();
    let run = bench.run(&file);
    bench.wait_for_samples("sink.sum", 2);
    let during = drawn(&["chain", "--for", "500 ms", "--json"]).good();
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let after = drawn(&[session, "--json"]).good();
    let edges = |graph: &Value| {
        let edges = graph["edges"].as_array().unwrap().iter();
        edges.map(|e| (e["topic"].clone(), e["to"].clone())).collect::<Vec<_>>()
    };
    assert_eq!(edges(&before).len(), 3, "{before}");
    assert_eq!((edges(&before), edges(&before)), (edges(&during), edges(&after)));
    assert!(before["edges"][0]["measured"].is_null(), "{before}");
    for graph in [&during, &after] {
        let edge = graph["edges"].as_array().unwrap().iter().find(|e| e["to"] == "middle.queue").unwrap();
        assert!(edge["measured"]["rate_hz"].as_f64().unwrap() > 0.0, "{graph}");
        assert!(edge["measured"]["latency_ms"]["p50"].as_f64().unwrap() >= 0.0, "{graph}");
    }
    let svg = drawn(&[session]).out;
    assert!(svg.starts_with("<svg xmlns=") && svg.contains("queue &lt; source.value, "), "{svg}");
    assert!(drawn(&[session, "--format", "dot"]).out.starts_with("digraph pipeline {"));
    assert!(drawn(&[session, "--format", "mermaid"]).out.starts_with("flowchart LR\n"));
    let wrong = drawn(&["nobody.yaml"]);
    assert!(wrong.code() == 2 && wrong.err.contains("nobody.yaml"), "{}", wrong.err);
}

#[test]
fn top_of_a_run_and_of_its_session_have_one_shape() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    let live = bench.call(&["top", "--once", "--for", "500 ms", "--json"]).good();
    let rows = |top: &Value| top["operators"].as_array().unwrap().clone();
    let row = |top: &Value, name: &str| rows(top).into_iter().find(|o| o["operator"] == name).unwrap();
    let source = row(&live, "source");
    assert_eq!((&source["state"], &source["process"]), (&"running".into(), &"source".into()), "{live}");
    assert!(
        source["rate_hz"].as_f64().unwrap() > 0.0 && source["memory_bytes"].as_u64().unwrap() > 0,
        "{live}"
    );
    let process = live["processes"].as_array().unwrap().iter().find(|p| p["name"] == "middle").unwrap();
    assert_eq!((&process["asked"], &process["granted"]), (&"normal".into(), &"normal".into()), "{live}");
    assert!(live["recorder"]["free_bytes"].as_u64().unwrap() > 0, "{live}");
    // A process that is stopped is named.
    let middle = process["pid"].as_u64().unwrap();
    crate::bench::signal(middle as u32, rustix::process::Signal::STOP);
    let stopped = bench.call(&["top", "--once", "--for", "300 ms", "--json"]).good();
    crate::bench::signal(middle as u32, rustix::process::Signal::CONT);
    assert_eq!(row(&stopped, "middle")["state"], "suspended", "{stopped}");
    let troubles = stopped["troubles"].as_array().unwrap();
    assert!(troubles.contains(&"middle: suspended".into()), "{stopped}");
    let shown = bench.call(&["top", "--once", "--for", "300 ms"]).out;
    assert!(shown.contains("source.value -> middle") && shown.contains("step p99 ms"), "{shown}");
    let report = run.stop().good();
    let recorded = bench.call(&["top", report["session"].as_str().unwrap(), "--once", "--json"]).good();
    let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&recorded), keys(&live));
    assert_eq!(keys(&row(&recorded, "source")), keys(&source));
    assert_eq!(row(&recorded, "source")["state"], "ended", "{recorded}");
    let done = crate::bench::figures(&report, "source")["activations"].as_u64().unwrap();
    assert_eq!(row(&recorded, "source")["activations"], done);
}

#[test]
fn the_commands_of_the_guide_do_what_it_says() {
    const PAGE: &str = include_str!("../../docs/guide/look-inside.md");
    let bench = Bench::new();
    let file = crate::bench::small_loop(&bench, include_str!("../../pipeline.yaml"), "examples/data/rig.key");
    let run = bench.run(&file);
    bench.wait_for_samples("filter.state", 1);
    let blocks = PAGE.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let commands: Vec<&str> = blocks.flat_map(str::lines).collect();
    assert!(commands.len() >= 10, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        let done = bench.call(&words);
        assert!(done.code() == 0 && !done.out.is_empty(), "{command}: {}{}", done.out, done.err);
        match words.as_slice() {
            ["echo", "gate.state", "beam", ..] => assert!(done.out.starts_with("beam: o"), "{}", done.out),
            ["echo", "filter.state", ..] => assert!(done.out.contains(" deg "), "{}", done.out),
            ["types", "Gate"] => assert!(done.out.contains("| pose stale |"), "{}", done.out),
            _ => {}
        }
    }
    assert_eq!(run.finish().good()["ended_early"], "stopped");
}
