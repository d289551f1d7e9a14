//! A snapshot on a terminal.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table, TableState, Wrap};

use super::keys::{Panel, View};
use super::plain::{cells, megabytes, number, words};
use super::snapshot::Snapshot;

/// Lines of what is wrong that are shown.
const TROUBLES: usize = 6;
/// Width of a terminal from which on all columns are shown.
const WIDE: u16 = 120;
/// The columns of operators that a narrow terminal shows.
const NARROW: [&str; 7] = ["state", "Hz", "step p50 ms", "step p99 ms", "missed", "lost", "CPU %"];

/// Draws the screen.
pub fn draw(frame: &mut Frame<'_>, snapshot: &Snapshot, view: &View) {
    let area = frame.area();
    let width = usize::from(area.width.max(20));
    let message: Vec<String> = wrapped(&words(snapshot), width);
    let troubles: Vec<&String> = snapshot.troubles.iter().take(TROUBLES).collect();
    let more = snapshot.troubles.len().saturating_sub(TROUBLES);
    let trouble_lines: u16 =
        troubles.iter().map(|t| (t.chars().count() + 2).div_ceil(width) as u16).sum::<u16>()
            + u16::from(more > 0);
    let [title, state, wrong, body, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(message.len() as u16),
        Constraint::Length(trouble_lines),
        Constraint::Min(3),
        Constraint::Length(1),
    ])
    .areas(area);

    frame.render_widget(Paragraph::new(head(snapshot, view)), title);
    let lines: Vec<Line<'_>> = message.into_iter().map(Line::from).collect();
    frame.render_widget(Paragraph::new(lines), state);
    let mut lines: Vec<Line<'_>> =
        troubles.into_iter().map(|t| Line::styled(format!("! {t}"), Style::new().fg(Color::Red))).collect();
    if more > 0 {
        lines.push(Line::styled(format!("! and {more} more"), Style::new().fg(Color::Red)));
    }
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }), wrong);
    match view.panel {
        Panel::Operators => operators(frame, body, snapshot, view),
        Panel::Edges => edges(frame, body, snapshot, view),
        Panel::Processes => processes(frame, body, snapshot, view),
        Panel::Operator => operator(frame, body, snapshot, view),
    }
    frame.render_widget(Paragraph::new(keys(view)), foot);
}

fn head(snapshot: &Snapshot, view: &View) -> Line<'static> {
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let mut spans = vec![
        Span::styled(snapshot.pipeline.clone(), bold),
        Span::raw(format!("  over {:.1} s", snapshot.seconds)),
    ];
    if view.paused {
        spans.push(Span::styled("  PAUSED", bold));
    }
    Line::from(spans)
}

fn keys(view: &View) -> String {
    if view.types {
        return format!("filter: {}_   Enter: keep   Esc: clear", view.filter);
    }
    match view.panel {
        Panel::Operator => "Esc: back   Up, Down: scroll   p: pause   q: end".to_owned(),
        _ => format!(
            "q: end  Tab: panel  Enter: open  s: sort ({})  /: filter{}  p: pause",
            view.sort.word(),
            if view.filter.is_empty() { String::new() } else { format!(" ({})", view.filter) }
        ),
    }
}

/// Joins parts to lines of at most `width` characters; a longer part is broken.
fn wrapped(parts: &[String], width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in parts {
        let letters: Vec<char> = part.chars().collect();
        for piece in letters.chunks(width) {
            let piece: String = piece.iter().collect();
            match lines.last_mut() {
                Some(line) if line.chars().count() + 3 + piece.chars().count() <= width => {
                    *line += " | ";
                    *line += &piece;
                }
                _ => lines.push(piece),
            }
        }
    }
    lines
}

/// A table whose first column takes what the others leave.
fn table(
    frame: &mut Frame<'_>,
    area: Rect,
    title: &'static str,
    head: &[&'static str],
    rows: Vec<Vec<String>>,
    chosen: usize,
) {
    let widths: Vec<usize> = (0..head.len())
        .map(|at| {
            rows.iter().map(|r| r[at].chars().count()).chain([head[at].chars().count()]).max().unwrap_or(0)
        })
        .collect();
    let constraints = widths.iter().enumerate().map(|(at, width)| {
        if at == 0 { Constraint::Min((*width).min(12) as u16) } else { Constraint::Length(*width as u16) }
    });
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let lines = rows.into_iter().map(|row| Row::new(row.into_iter().map(Cell::from)));
    let drawn = Table::new(lines, constraints)
        .header(Row::new(head.iter().map(|h| Cell::from(*h))).style(bold))
        .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED))
        .block(Block::new().borders(Borders::TOP).title(title));
    let mut state = TableState::default().with_selected(Some(chosen));
    frame.render_stateful_widget(drawn, area, &mut state);
}

fn operators(frame: &mut Frame<'_>, area: Rect, snapshot: &Snapshot, view: &View) {
    let all = view.operators(snapshot);
    let is_shown = |name: &str| area.width >= WIDE || NARROW.contains(&name);
    let mut head = vec!["operator"];
    if let Some(first) = snapshot.operators.first() {
        head.extend(cells(first).iter().map(|(name, _)| *name).filter(|name| is_shown(name)));
    }
    let row = |o: &&super::snapshot::OperatorRow| {
        let rest = cells(o).into_iter().filter(|(name, _)| is_shown(name)).map(|(_, text)| text);
        std::iter::once(o.operator.clone()).chain(rest).collect()
    };
    table(frame, area, " operators ", &head, all.iter().map(row).collect(), view.row);
}

fn edges(frame: &mut Frame<'_>, area: Rect, snapshot: &Snapshot, view: &View) {
    let head = ["edge", "Hz", "latency ms", "p99", "age ms", "passed", "lost"];
    let row = |e: &stillpoint_report::trace::EdgeFigures| {
        vec![
            format!("{} -> {}", e.topic, e.to),
            number(e.rate_hz, 1),
            number(e.latency_ms.p50, 2),
            number(e.latency_ms.p99, 2),
            number(e.age_ms.p50, 1),
            e.passed.to_string(),
            e.lost.to_string(),
        ]
    };
    let shown =
        snapshot.edges.iter().filter(|e| e.topic.contains(&view.filter) || e.to.contains(&view.filter));
    table(frame, area, " edges ", &head, shown.map(row).collect(), view.row);
}

fn processes(frame: &mut Frame<'_>, area: Rect, snapshot: &Snapshot, view: &View) {
    let head = ["process", "PID", "CPU %", "no core %", "MB", "priority", "cores"];
    let row = |p: &super::snapshot::ProcessRow| {
        vec![
            p.state.name.clone(),
            p.state.pid.to_string(),
            number(p.cpu_percent, 0),
            number(p.delayed_percent, 1),
            megabytes(Some(p.state.memory_bytes)),
            p.state.granted.clone(),
            p.state.cores.clone(),
        ]
    };
    table(frame, area, " processes ", &head, snapshot.processes.iter().map(row).collect(), view.row);
}

fn operator(frame: &mut Frame<'_>, area: Rect, snapshot: &Snapshot, view: &View) {
    let Some(open) = &view.open else { return };
    let mut lines: Vec<Line<'_>> = Vec::new();
    if let Some(o) = snapshot.operators.iter().find(|o| o.operator == *open) {
        let message = cells(o).into_iter().map(|(name, text)| format!("{name} {text}"));
        lines.push(Line::from(message.collect::<Vec<_>>().join("   ")));
    }
    lines.extend(view.detail.iter().map(|line| Line::from(line.clone())));
    let block = Block::new().borders(Borders::TOP).title(format!(" {open} "));
    let scroll = view.row.min(lines.len().saturating_sub(1)) as u16;
    let shown = Paragraph::new(lines).wrap(Wrap { trim: false }).scroll((scroll, 0)).block(block);
    frame.render_widget(shown, area);
}

#[cfg(test)]
mod tests;
