//! Where boxes and lines are.
//!
//! Operators stand in columns, one behind all that feed it, and in a band for each process. Lines run only where no box can
//! be: upright in the channels between columns, across in lanes below the boxes of a band. Each topic has lines of its own.
//! All names are in boxes, or in the margin on the left, which no line enters.

use std::collections::BTreeMap;

use super::Drawing;

/// Width of a letter of the font, which has one width for all.
pub const LETTER: f64 = 7.3;
/// Height of a row of a box.
pub const ROW: f64 = 17.0;
/// Room inside a box beside its text.
const PAD: f64 = 9.0;
/// Distance of two lines, and of lines and boxes.
const TRACK: f64 = 8.0;
const GAP: f64 = 14.0;

/// A text with its place: left end of its baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    pub x: f64,
    pub y: f64,
    pub text: String,
    pub class: &'static str,
}

impl Label {
    /// Left, top, right, bottom.
    #[cfg(test)]
    pub fn rectangle(&self) -> [f64; 4] {
        [self.x, self.y - 11.0, self.x + self.text.chars().count() as f64 * LETTER, self.y + 4.0]
    }
}

/// A rectangle: left, top, width, height.
#[derive(Clone, Debug, PartialEq)]
pub struct Rectangle {
    pub at: [f64; 4],
    pub class: &'static str,
}

/// A line of upright and level pieces that ends at an input.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    pub points: Vec<(f64, f64)>,
    pub class: &'static str,
}

/// All that is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    pub size: (f64, f64),
    pub rectangles: Vec<Rectangle>,
    pub lines: Vec<Line>,
    pub labels: Vec<Label>,
}

/// A box of an operator: its rows.
struct Shape {
    column: usize,
    band: usize,
    width: f64,
    /// Text of each row below the name: inputs, then outputs.
    inputs: Vec<(usize, String)>,
    outputs: Vec<String>,
}

impl Shape {
    fn height(&self) -> f64 {
        ROW * (1 + self.inputs.len() + self.outputs.len()) as f64 + 8.0
    }

    fn input_row(&self, input: usize) -> usize {
        1 + self.inputs.iter().position(|(i, _)| *i == input).unwrap_or(0)
    }

    fn output_row(&self, output: usize) -> usize {
        1 + self.inputs.len() + output
    }
}

/// Numbers from 0 on for the users of a place, in the order in which they reserve one.
#[derive(Default)]
struct Tracks<K: Ord>(BTreeMap<K, BTreeMap<(usize, usize, usize), usize>>);

impl<K: Ord> Tracks<K> {
    fn reserve(&mut self, place: K, user: (usize, usize, usize)) {
        let users = self.0.entry(place).or_default();
        let next = users.len();
        users.entry(user).or_insert(next);
    }

    fn of(&self, place: &K, user: (usize, usize, usize)) -> usize {
        self.0.get(place).and_then(|users| users.get(&user)).copied().unwrap_or(0)
    }

    fn count(&self, place: &K) -> usize {
        self.0.get(place).map_or(0, BTreeMap::len)
    }
}

/// The bands: host and process of each, in the order of the operators, those of a host together.
fn bands(drawing: &Drawing) -> Vec<(String, String)> {
    let mut hosts: Vec<&str> = Vec::new();
    for node in &drawing.operators {
        if !hosts.contains(&node.host.as_str()) {
            hosts.push(&node.host);
        }
    }
    let mut bands: Vec<(String, String)> = Vec::new();
    for host in hosts {
        for node in drawing.operators.iter().filter(|n| n.host == host) {
            let band = (node.host.clone(), node.process.clone());
            if !bands.contains(&band) {
                bands.push(band);
            }
        }
    }
    bands
}

fn host_title(host: &str) -> String {
    if host.is_empty() { String::new() } else { format!("host {host}") }
}

/// Places everything.
pub fn place(drawing: &Drawing) -> Layout {
    let bands = bands(drawing);
    let shapes = shapes(drawing, &bands);
    let columns = shapes.iter().map(|s| s.column + 1).max().unwrap_or(0);

    // Which lines go where. Channel c is left of column c.
    let mut channels: Tracks<usize> = Tracks::default();
    let mut lanes: Tracks<usize> = Tracks::default();
    for edge in &drawing.edges {
        let (from, to) = (&shapes[edge.from.0], &shapes[edge.into.0]);
        let topic = (edge.from.0, edge.from.1, 0);
        channels.reserve(from.column + 1, topic);
        if to.column != from.column + 1 {
            lanes.reserve(to.band, topic);
            channels.reserve(to.column, (edge.from.0, edge.from.1, 1 + to.band));
        }
    }

    // Sizes.
    let title = |text: &str| text.chars().count() as f64 * LETTER;
    let titles = bands.iter().flat_map(|(host, process)| [title(process), title(&host_title(host))]);
    let margin = titles.fold(0.0, f64::max) + 2.0 * PAD;
    let channel_width = |c: usize| channels.count(&c) as f64 * TRACK + 2.0 * GAP;
    let mut lefts = Vec::new();
    let mut x = margin;
    for column in 0..columns {
        x += channel_width(column);
        lefts.push(x);
        let wide = shapes.iter().filter(|s| s.column == column).map(|s| s.width);
        x += wide.fold(0.0, f64::max);
    }
    let width = x + channel_width(columns);
    let channel_left = |c: usize| {
        if c < columns { lefts[c] - channel_width(c) + GAP } else { width - channel_width(columns) + GAP }
    };

    let mut layout = Layout::default();
    let mut tops = vec![0.0; shapes.len()];
    let mut lane_tops = Vec::new();
    let mut y = 0.0;
    let mut host_top: Option<(String, f64)> = None;
    for (number, (host, process)) in bands.iter().enumerate() {
        if host_top.as_ref().is_none_or(|(h, _)| h != host) {
            close_host(&mut layout, host_top.take(), y, width);
            if !host.is_empty() {
                y += GAP;
                layout.labels.push(Label { x: PAD, y: y + 13.0, text: host_title(host), class: "host" });
                host_top = Some((host.clone(), y));
                y += ROW;
            }
        }
        let top = y + GAP / 2.0;
        let mut deepest: f64 = ROW;
        for column in 0..columns {
            let mut at = top + GAP;
            for (shape, s) in
                shapes.iter().enumerate().filter(|(_, s)| s.band == number && s.column == column)
            {
                tops[shape] = at;
                at += s.height() + GAP;
                deepest = deepest.max(at - top);
            }
        }
        lane_tops.push(top + deepest + TRACK);
        let height = deepest + lanes.count(&number) as f64 * TRACK + 2.0 * TRACK;
        layout.rectangles.push(Rectangle { at: [PAD / 2.0, top, width - PAD, height], class: "process" });
        layout.labels.push(Label { x: PAD, y: top + 14.0, text: process.clone(), class: "process" });
        y = top + height + GAP / 2.0;
    }
    close_host(&mut layout, host_top, y, width);
    layout.size = (width, y + GAP);

    for (number, shape) in shapes.iter().enumerate() {
        draw_box(&mut layout, shape, &drawing.operators[number].name, lefts[shape.column], tops[number]);
    }
    for edge in &drawing.edges {
        let (from, to) = (&shapes[edge.from.0], &shapes[edge.into.0]);
        let topic = (edge.from.0, edge.from.1, 0);
        let middle = |number: usize, row: usize| tops[number] + ROW * (row as f64 + 0.5) + 4.0;
        let start = (lefts[from.column] + from.width, middle(edge.from.0, from.output_row(edge.from.1)));
        let end = (lefts[to.column], middle(edge.into.0, to.input_row(edge.into.1)));
        let track = |c: usize, number: usize| channel_left(c) + number as f64 * TRACK;
        let first = track(from.column + 1, channels.of(&(from.column + 1), topic));
        let mut points = vec![start, (first, start.1)];
        if to.column != from.column + 1 {
            let lane = lane_tops[to.band] + lanes.of(&to.band, topic) as f64 * TRACK;
            let last = track(to.column, channels.of(&to.column, (edge.from.0, edge.from.1, 1 + to.band)));
            points.extend([(first, lane), (last, lane), (last, end.1)]);
        } else {
            points.push((first, end.1));
        }
        points.push(end);
        let class = match (edge.is_link, edge.closes_loop) {
            (_, true) => "loop",
            (true, _) => "link",
            _ => "edge",
        };
        layout.lines.push(Line { points, class });
    }
    layout
}

fn close_host(layout: &mut Layout, host: Option<(String, f64)>, bottom: f64, width: f64) {
    if let Some((_, top)) = host {
        let at = [1.0, top, width - 2.0, bottom - top];
        layout.rectangles.insert(0, Rectangle { at, class: "host" });
    }
}

fn draw_box(layout: &mut Layout, shape: &Shape, name: &str, left: f64, top: f64) {
    layout.rectangles.push(Rectangle { at: [left, top, shape.width, shape.height()], class: "operator" });
    let mut row = 0.0;
    let mut put = |text: &str, class: &'static str, right: bool| {
        let wide = text.chars().count() as f64 * LETTER;
        let x = if right { left + shape.width - PAD - wide } else { left + PAD };
        row += 1.0;
        layout.labels.push(Label { x, y: top + ROW * row, text: text.to_owned(), class });
    };
    put(name, "name", false);
    for (_, text) in &shape.inputs {
        put(text, "input", false);
    }
    for text in &shape.outputs {
        put(text, "output", true);
    }
}

fn shapes(drawing: &Drawing, bands: &[(String, String)]) -> Vec<Shape> {
    let mut columns = vec![0; drawing.operators.len()];
    for to in 0..columns.len() {
        let before = drawing.edges.iter().filter(|e| e.into.0 == to && e.from.0 < to);
        columns[to] = before.map(|e| columns[e.from.0] + 1).max().unwrap_or(0);
    }
    let shape = |(number, node): (usize, &super::Node)| {
        let mut inputs: Vec<(usize, String)> = drawing
            .edges
            .iter()
            .filter(|e| e.into.0 == number)
            .map(|e| {
                let name = &node.inputs[e.into.1];
                let sentence = [&[format!("{name} < {}", e.topic)][..], &e.words()].concat();
                (e.into.1, sentence.join(", "))
            })
            .collect();
        inputs.sort();
        let outputs: Vec<String> = node
            .outputs
            .iter()
            .map(|topic| format!("{} >", topic.strip_prefix(&format!("{}.", node.name)).unwrap_or(topic)))
            .collect();
        let sentence = inputs.iter().map(|(_, text)| text).chain(&outputs).chain([&node.name]);
        let longest = sentence.map(|text| text.chars().count()).max().unwrap_or(0);
        let band = bands.iter().position(|(h, p)| *h == node.host && *p == node.process).unwrap_or(0);
        let width = longest as f64 * LETTER + 2.0 * PAD;
        Shape { column: columns[number], band, width, inputs, outputs }
    };
    drawing.operators.iter().enumerate().map(shape).collect()
}
