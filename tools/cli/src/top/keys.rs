//! What the keys of the terminal do.

use ratatui::crossterm::event::KeyCode;

use super::snapshot::{OperatorRow, Snapshot};

/// What the lower part of the screen shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// The table of operators.
    Operators,
    /// The table of edges.
    Edges,
    /// The table of processes.
    Processes,
    /// One operator.
    Operator,
}

/// By what the operators are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// Upstream first.
    Pipeline,
    /// The longest step first.
    Step,
    /// The process with the most CPU time first.
    Cpu,
    /// The most frequent first.
    Rate,
    /// The most missed ticks, losses and failures first.
    Losses,
}

/// What is shown, as the keys have set it.
#[derive(Clone, Debug)]
pub struct View {
    /// The lower part.
    pub panel: Panel,
    /// The order of operators.
    pub sort: Sort,
    /// Only names that contain this.
    pub filter: String,
    /// Keys go to the filter.
    pub types: bool,
    /// The picture stands still.
    pub paused: bool,
    /// Number of the row that is chosen.
    pub row: usize,
    /// The operator that is open.
    pub open: Option<String>,
    /// Lines of the open operator: its parameters and its last samples.
    pub detail: Vec<String>,
}

impl Default for View {
    fn default() -> Self {
        Self {
            panel: Panel::Operators,
            sort: Sort::Pipeline,
            filter: String::new(),
            types: false,
            paused: false,
            row: 0,
            open: None,
            detail: Vec::new(),
        }
    }
}

impl Sort {
    /// The order as a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pipeline => "pipeline",
            Self::Step => "step",
            Self::Cpu => "CPU",
            Self::Rate => "rate",
            Self::Losses => "losses",
        }
    }

    fn next(self) -> Self {
        match self {
            Self::Pipeline => Self::Step,
            Self::Step => Self::Cpu,
            Self::Cpu => Self::Rate,
            Self::Rate => Self::Losses,
            Self::Losses => Self::Pipeline,
        }
    }
}

impl View {
    /// Does what a key says; false where it ends the command.
    pub fn key(&mut self, key: KeyCode, snapshot: &Snapshot) -> bool {
        if self.types {
            match key {
                KeyCode::Char(letter) => self.filter.push(letter),
                KeyCode::Backspace => drop(self.filter.pop()),
                KeyCode::Esc => {
                    self.filter.clear();
                    self.types = false;
                }
                KeyCode::Enter => self.types = false,
                _ => {}
            }
            self.row = 0;
            return true;
        }
        match key {
            KeyCode::Char('q') => return false,
            KeyCode::Esc if self.panel == Panel::Operator => self.panel = Panel::Operators,
            KeyCode::Esc => self.filter.clear(),
            KeyCode::Char('p' | ' ') => self.paused = !self.paused,
            KeyCode::Char('s') => self.sort = self.sort.next(),
            KeyCode::Char('/') => self.types = true,
            KeyCode::Tab => {
                self.row = 0;
                self.panel = match self.panel {
                    Panel::Operators => Panel::Edges,
                    Panel::Edges => Panel::Processes,
                    Panel::Processes | Panel::Operator => Panel::Operators,
                };
            }
            KeyCode::Down | KeyCode::Char('j') => self.row = self.row.saturating_add(1),
            KeyCode::Up | KeyCode::Char('k') => self.row = self.row.saturating_sub(1),
            KeyCode::Enter if self.panel == Panel::Operators => {
                if let Some(operator) = self.operators(snapshot).get(self.row) {
                    self.open = Some(operator.operator.clone());
                    self.panel = Panel::Operator;
                }
            }
            _ => {}
        }
        self.row = self.row.min(self.rows(snapshot).saturating_sub(1));
        true
    }

    fn rows(&self, snapshot: &Snapshot) -> usize {
        match self.panel {
            Panel::Operators => self.operators(snapshot).len(),
            Panel::Edges => snapshot.edges.len(),
            Panel::Processes => snapshot.processes.len(),
            Panel::Operator => usize::MAX,
        }
    }

    /// The operators as filter and order have them.
    pub fn operators<'s>(&self, snapshot: &'s Snapshot) -> Vec<&'s OperatorRow> {
        let mut rows: Vec<&OperatorRow> =
            snapshot.operators.iter().filter(|o| o.operator.contains(&self.filter)).collect();
        let losses = |o: &OperatorRow| {
            let f = &o.figures;
            (f.missed + f.lost + f.errors + f.panics) as f64
        };
        let by = |rows: &mut Vec<&OperatorRow>, of: &dyn Fn(&OperatorRow) -> f64| {
            let known = |o: &OperatorRow| Some(of(o)).filter(|v| v.is_finite()).unwrap_or(-1.0);
            rows.sort_by(|a, b| known(b).total_cmp(&known(a)));
        };
        match self.sort {
            Sort::Pipeline => {}
            Sort::Step => by(&mut rows, &|o| o.figures.step_ms[1]),
            Sort::Cpu => by(&mut rows, &|o| o.cpu_percent.unwrap_or(-1.0)),
            Sort::Rate => by(&mut rows, &|o| o.figures.rate_hz),
            Sort::Losses => by(&mut rows, &losses),
        }
        rows
    }
}
