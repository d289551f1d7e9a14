use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::KeyCode;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_report::trace::EdgeFigures;

use super::super::keys::Sort;
use super::super::snapshot::{OperatorRow, RecorderRow};
use super::*;

fn operator(name: &str, step: f64, missed: u64) -> OperatorRow {
    OperatorRow {
        operator: name.into(),
        process: "control".into(),
        state: "running",
        figures: OperatorFigures {
            operator: name.into(),
            activations: 100,
            rate_hz: 50.0,
            errors: 0,
            panics: 0,
            incarnations: 0,
            sent: 100,
            sent_by_output: vec![100],
            lost: 0,
            ticks: 100,
            missed,
            step_ms: [step, 2.0 * step],
            age_ms: [12.5, 20.0],
        },
        restarts: 0,
        cpu_percent: Some(37.0),
        memory_bytes: Some(45_000_000),
    }
}

fn snapshot() -> Snapshot {
    Snapshot {
        of: serde_json::json!({ "run": 7 }),
        pipeline: "head-3dof".into(),
        seconds: 2.0,
        troubles: vec!["law: missed 40 of 140 ticks; a step takes 31.2 ms (p99 60.5 ms), which is longer than its period".into()],
        found: vec!["frames: 20, of which 19 with a face".into()],
        held: None,
        operators: vec![operator("cloud", 1.5, 0), operator("law", 30.0, 40), operator("gate", 0.1, 0)],
        edges: vec![EdgeFigures {
            topic: "cloud.cloud".into(),
            to: "law".into(),
            input: 0,
            taken: 20,
            rate_hz: Some(10.0),
            latency_ms: stillpoint_report::trace::Spread::default(),
            age_ms: stillpoint_report::trace::Spread::default(),
            lost: 3,
            passed: 0,
        }],
        contracts: Vec::new(),
        processes: Vec::new(),
        changed: Vec::new(),
        recorder: Some(RecorderRow { session: "sessions/head-3dof-0001".into(), bytes: 4_100_000, free_bytes: None }),
        clock_set_s: Some(0.0),
    }
}

/// The screen as lines of text.
fn screen(width: u16, snapshot: &Snapshot, view: &View) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, 24)).unwrap_or_else(|e| panic!("{e}"));
    terminal.draw(|frame| draw(frame, snapshot, view)).unwrap_or_else(|e| panic!("{e}"));
    let buffer = terminal.backend().buffer();
    let cells = buffer.content.chunks(usize::from(width));
    cells
        .map(|row| row.iter().map(ratatui::buffer::Cell::symbol).collect::<String>().trim_end().to_owned())
        .collect()
}

#[test]
fn a_terminal_of_80_columns_shows_every_operator_and_all_of_what_is_wrong() {
    let lines = screen(80, &snapshot(), &View::default());
    let all = lines.join("\n");
    assert!(lines[0].starts_with("head-3dof  over 2.0 s"), "{all}");
    assert!(all.contains("frames: 20, of which 19 with a face"), "{all}");
    assert!(all.contains("session sessions/head-3dof-0001: 4.1 MB"), "{all}");
    // A trouble that is longer than the screen is wide goes on in the next line.
    assert!(all.contains("! law: missed 40 of 140 ticks") && all.contains("than its period"), "{all}");
    for words in [
        ["cloud", "running", "50.0", "1.50", "3.00", "0", "0", "37"],
        ["law", "running", "50.0", "30.00", "60.00", "40", "0", "37"],
    ] {
        assert!(lines.iter().any(|l| l.split_whitespace().eq(words)), "{words:?} are not in\n{all}");
    }
    assert!(lines.iter().any(|l| l.contains("q: end")), "{all}");
}

#[test]
fn a_terminal_of_160_columns_shows_age_restarts_memory_and_process_too() {
    let lines = screen(160, &snapshot(), &View::default());
    let head = lines.iter().find(|l| l.starts_with("operator")).unwrap_or_else(|| panic!("{lines:?}"));
    for word in ["age p50 ms", "restarts", "failed", "MB", "process"] {
        assert!(head.contains(word), "{word}: {head}");
    }
    let row = lines.iter().find(|l| l.starts_with("gate")).unwrap_or_else(|| panic!("{lines:?}"));
    assert!(row.contains("12.5") && row.contains("45") && row.ends_with("control"), "{row}");
}

#[test]
fn keys_sort_filter_pause_change_the_panel_and_open_an_operator() {
    let snapshot = snapshot();
    let mut view = View::default();
    let first = |view: &View, width: u16| {
        let lines = screen(width, &snapshot, view);
        let head = lines.iter().position(|l| l.starts_with("operator") || l.starts_with("edge"));
        lines[head.unwrap_or_else(|| panic!("{lines:?}")) + 1].clone()
    };
    assert!(first(&view, 80).starts_with("cloud"));
    assert!(view.key(KeyCode::Char('s'), &snapshot));
    assert_eq!(view.sort, Sort::Step);
    assert!(first(&view, 80).starts_with("law"));
    for key in
        [KeyCode::Char('/'), KeyCode::Char('g'), KeyCode::Char('q'), KeyCode::Backspace, KeyCode::Enter]
    {
        assert!(view.key(key, &snapshot), "{key:?}");
    }
    assert!(first(&view, 80).starts_with("gate"));
    assert!(view.key(KeyCode::Enter, &snapshot));
    assert_eq!((view.panel, view.open.as_deref()), (Panel::Operator, Some("gate")));
    view.detail = vec!["params: { every: 10 ms }".into()];
    let open = screen(80, &snapshot, &view).join("\n");
    assert!(open.contains("params: { every: 10 ms }") && open.contains(" gate "), "{open}");
    assert!(view.key(KeyCode::Esc, &snapshot) && view.key(KeyCode::Esc, &snapshot));
    assert!(view.key(KeyCode::Tab, &snapshot));
    assert!(first(&view, 80).starts_with("cloud.cloud -> law"));
    assert!(view.key(KeyCode::Char('p'), &snapshot) && view.paused);
    assert!(screen(80, &snapshot, &view)[0].contains("PAUSED"));
    assert!(!view.key(KeyCode::Char('q'), &snapshot));
}
