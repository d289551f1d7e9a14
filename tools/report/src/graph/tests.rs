use super::layout::{Layout, place};
use super::*;

/// A pipeline of two cameras in processes of their own, a fusion, a law, and a loop back to the first camera; and an edge
/// that passes over two columns.
fn drawing() -> Drawing {
    let node = |name: &str, process: &str, host: &str, inputs: &[&str], outputs: &[&str]| Node {
        name: name.into(),
        kind: "kit.any".into(),
        process: process.into(),
        host: host.into(),
        inputs: inputs.iter().map(|i| i.to_string()).collect(),
        outputs: outputs.iter().map(|o| format!("{name}.{o}")).collect(),
        ..Node::default()
    };
    let operators = vec![
        node("left", "left", "room", &["duties"], &["depth", "truth"]),
        node("right", "right", "room", &[], &["depth"]),
        node("fusion", "perception", "room", &["a", "b"], &["state"]),
        node("law", "control", "cluster", &["state", "image"], &["duties"]),
        node("gate", "control", "cluster", &["state", "duties"], &["datagram"]),
    ];
    let edge = |from: (usize, usize), into: (usize, usize)| Edge {
        topic: operators[from.0].outputs[from.1].clone(),
        to: format!("{}.{}", operators[into.0].name, operators[into.0].inputs[into.1]),
        from,
        into,
        closes_loop: from.0 >= into.0,
        delay_ms: if from.0 >= into.0 { 2.0 } else { 0.0 },
        ..Edge::default()
    };
    let edges = vec![
        edge((0, 0), (2, 0)),
        edge((0, 0), (3, 1)),
        edge((1, 0), (2, 1)),
        edge((2, 0), (3, 0)),
        edge((2, 0), (4, 0)),
        edge((3, 0), (4, 1)),
        edge((3, 0), (0, 0)),
    ];
    Drawing { operators, edges }
}

/// Whether a piece of a line, which is upright or level, goes through a rectangle (left, top, right, bottom).
fn passes(a: (f64, f64), b: (f64, f64), [left, top, right, bottom]: [f64; 4]) -> bool {
    let (x, y) = ((a.0.min(b.0), a.0.max(b.0)), (a.1.min(b.1), a.1.max(b.1)));
    x.1 > left && x.0 < right && y.1 > top && y.0 < bottom
}

fn check(layout: &Layout) {
    for line in &layout.lines {
        for piece in line.points.windows(2) {
            assert!(piece[0].0 == piece[1].0 || piece[0].1 == piece[1].1, "{piece:?} is slanted");
            for label in &layout.labels {
                assert!(!passes(piece[0], piece[1], label.rectangle()), "{piece:?} goes through {label:?}");
            }
            for rectangle in layout.rectangles.iter().filter(|r| r.class == "operator") {
                let [x, y, w, h] = rectangle.at;
                assert!(
                    !passes(piece[0], piece[1], [x, y, x + w, y + h]),
                    "{piece:?} goes through {rectangle:?}"
                );
            }
        }
    }
    let (width, height) = layout.size;
    let inside = |(x, y): (f64, f64)| x >= 0.0 && x <= width && y >= 0.0 && y <= height;
    assert!(layout.lines.iter().flat_map(|l| &l.points).all(|p| inside(*p)));
    for (number, label) in layout.labels.iter().enumerate() {
        let [left, top, right, bottom] = label.rectangle();
        assert!(inside((left, top)) && inside((right, bottom)), "{label:?} is outside {:?}", layout.size);
        for other in &layout.labels[..number] {
            let [l, t, r, b] = other.rectangle();
            assert!(right <= l || r <= left || bottom <= t || b <= top, "{label:?} covers {other:?}");
        }
    }
}

#[test]
fn no_line_goes_through_a_name_or_a_box() {
    let drawing = drawing();
    let layout = place(&drawing);
    assert_eq!(layout.lines.len(), drawing.edges.len());
    check(&layout);
    // A check that cannot fail proves nothing.
    let mut wrong = layout;
    let label = wrong.labels[0].clone();
    let [left, top, right, bottom] = label.rectangle();
    let middle = f64::midpoint(top, bottom);
    wrong.lines[0].points = vec![(left - 1.0, middle), (right + 1.0, middle)];
    assert!(std::panic::catch_unwind(|| check(&wrong)).is_err());
}

#[test]
fn many_operators_with_many_edges_have_no_line_through_a_name() {
    // Each operator takes what three others send, before or behind it.
    let count = 40;
    let name = |i: usize| format!("operator_{i}");
    let operators: Vec<Node> = (0..count)
        .map(|i| Node {
            name: name(i),
            process: format!("process {}", i % 7),
            host: format!("host {}", i % 2),
            inputs: (0..3).map(|p| format!("input_{p}")).collect(),
            outputs: vec![format!("{}.out", name(i))],
            ..Node::default()
        })
        .collect();
    let edges =
        (0..count).flat_map(|to| (0..3).map(move |port| ((to * 7 + port * 11 + 3) % count, to, port)));
    let edges = edges.map(|(from, to, port)| Edge {
        topic: format!("{}.out", name(from)),
        to: format!("{}.input_{port}", name(to)),
        from: (from, 0),
        into: (to, port),
        closes_loop: from >= to,
        ..Edge::default()
    });
    check(&place(&Drawing { operators, edges: edges.collect() }));
}

#[test]
fn a_picture_has_processes_hosts_loops_ports_and_topics_in_each_language() {
    let drawing = drawing();
    let svg = svg(&drawing);
    for word in [
        "host room",
        "perception",
        "duties &lt; law.duties, loop, delay 2 ms",
        "class=\"loop\"",
        "state &gt;",
    ] {
        assert!(svg.contains(word), "{word} is not in {svg}");
    }
    let dot = dot(&drawing);
    for word in [
        "label=\"host cluster\"",
        "label=\"control\"",
        "o3 -> o0 [label=\"law.duties > duties\\nloop\\ndelay 2 ms\", style=dashed",
    ] {
        assert!(dot.contains(word), "{word} is not in {dot}");
    }
    assert_eq!(dot.matches('{').count(), dot.matches('}').count());
    let mermaid = mermaid(&drawing);
    for word in [
        "flowchart LR",
        "subgraph h0[\"host room\"]",
        "o3 -.->|\"law.duties #gt; duties<br/>loop<br/>delay 2 ms\"| o0",
    ] {
        assert!(mermaid.contains(word), "{word} is not in {mermaid}");
    }
    assert_eq!(mermaid.matches("subgraph").count(), mermaid.matches("  end\n").count());
}
