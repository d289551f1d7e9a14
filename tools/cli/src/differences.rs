//! How two sessions differ, for people: of a what-if against its recording, and of any two sessions.

use stillpoint_report::compare::{Alignment, Comparison, FieldDifference, TopicDifference, Trend};
use stillpoint_report::numbers;

use crate::columns::{Columns, Side};

/// Fields of a topic that are shown; JSON and the page have all.
const MOST_FIELDS: usize = 4;

/// Prints what differs, topic by topic, and the figures of both runs under these names.
pub fn print(comparison: &Comparison, names: [&str; 2]) {
    let (identical, changed): (Vec<_>, Vec<_>) = comparison.topics.iter().partition(|t| t.identical);
    if !identical.is_empty() {
        let (journals, topics): (Vec<_>, Vec<_>) = identical.into_iter().partition(|t| is_journal(t));
        if !topics.is_empty() {
            let topics: Vec<&str> = topics.iter().map(|t| t.topic.as_str()).collect();
            outln!("identical to the bit: {}", topics.join(", "));
        }
        if !journals.is_empty() {
            outln!("identical journals: {} of {}", journals.len(), count_of_journals(comparison));
        }
    }
    let (journals, topics): (Vec<_>, Vec<_>) = changed.into_iter().partition(|t| is_journal(t));
    if !topics.is_empty() {
        out!("{}", table(&topics));
    }
    let more: usize = topics.iter().map(|t| t.fields.len().saturating_sub(MOST_FIELDS)).sum();
    if more > 0 {
        outln!("and {more} more fields: --json has them");
    }
    for topic in topics.iter().filter(|t| t.alone != [0, 0]) {
        let [a, b] = topic.alone;
        outln!("{}: {a} samples only in {}, {b} only in {}", topic.topic, names[0], names[1]);
    }
    if !journals.is_empty() {
        outln!("other activations: the journals of {} operators differ", journals.len());
    }
    for (side, only) in comparison.only.iter().enumerate().filter(|(_, only)| !only.is_empty()) {
        outln!("only in {}: {}", names[side], only.join(", "));
    }
    if !comparison.unread.is_empty() {
        outln!(
            "not compared, because the types differ or are of another program: {}",
            comparison.unread.join(", ")
        );
    }
    if let Some(first) = &comparison.first {
        let field = first.field.as_ref().map_or(String::new(), |field| format!(" in {field}"));
        outln!("the first difference: {}{field}, at {:.3} s", first.topic, first.at_s);
    }
    if !comparison.figures.is_empty() {
        let mut figures = Columns::new([
            (Side::Left, "figure of the end"),
            (Side::Right, names[0]),
            (Side::Right, names[1]),
        ]);
        for figure in &comparison.figures {
            let text = |value: Option<f64>| {
                let unit = if figure.unit.is_empty() { String::new() } else { format!(" {}", figure.unit) };
                value.map_or("-".to_owned(), |value| format!("{}{unit}", numbers::short(value)))
            };
            figures.row([figure.name.clone(), text(figure.values[0]), text(figure.values[1])]);
        }
        out!("{figures}");
    }
}

fn is_journal(topic: &TopicDifference) -> bool {
    topic.kind == "Journal"
}

fn count_of_journals(comparison: &Comparison) -> usize {
    comparison.topics.iter().filter(|t| is_journal(t)).count()
}

fn table(topics: &[&TopicDifference]) -> Columns {
    let mut table = Columns::new([
        (Side::Left, "topic and field"),
        (Side::Right, "differing"),
        (Side::Right, "since, s"),
        (Side::Right, "rms"),
        (Side::Right, "largest"),
        (Side::Right, "at, s"),
        (Side::Left, "then"),
    ]);
    let time = |at: Option<f64>| at.map_or(String::new(), |at| format!("{at:.3}"));
    for topic in topics {
        let by = if topic.alignment == Alignment::Sequence { " (by sequence)" } else { "" };
        let lead = format!("{}{by}", topic.topic);
        let differing = format!("{} of {}", topic.differing, topic.pairs);
        let since = time(topic.since_s);
        let empty = [(); 4].map(|()| String::new());
        table.row([lead, differing, since].into_iter().chain(empty));
        for field in topic.fields.iter().take(MOST_FIELDS) {
            table.row(row(field, time));
        }
    }
    table
}

fn row(field: &FieldDifference, time: impl Fn(Option<f64>) -> String) -> [String; 7] {
    let number = |value: Option<f64>| value.map_or(String::new(), numbers::short);
    let unit = if field.unit.is_empty() { String::new() } else { format!(", {}", field.unit) };
    let trend = match field.trend {
        Some(Trend::Grows) => "grows",
        Some(Trend::Fades) => "fades",
        Some(Trend::Stays) => "stays",
        None => "",
    };
    [
        format!("  {}{unit}", field.field),
        field.samples.to_string(),
        time(Some(field.since_s)),
        number(field.rms),
        number(field.worst),
        time(field.worst_s),
        trend.to_owned(),
    ]
}
