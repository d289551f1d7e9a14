//! Charts and small lines as they stand in the page: in its colours, with names and titles in its text.

use super::escape::{escape, printable};
use crate::chart::{Chart, Series, Style, colour};

/// Size of a chart, in units that the page scales.
const CHART: (u32, u32) = (580, 240);

/// A small line through points, from their least to their greatest values; nothing where there are not two.
pub fn spark(points: &[(f64, f64)]) -> String {
    const SIZE: (f64, f64) = (150.0, 20.0);
    let finite: Vec<_> = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
    let ends = |of: fn(&(f64, f64)) -> f64| {
        let values = finite.iter().map(|p| of(p));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
    };
    let place = |v: f64, (low, high): (f64, f64), size: f64| {
        if high > low { (v - low) / (high - low) * (size - 2.0) + 1.0 } else { size / 2.0 }
    };
    if finite.len() < 2 {
        return String::new();
    }
    let (x, y) = (ends(|p| p.0), ends(|p| p.1));
    let line: Vec<String> = finite
        .iter()
        .map(|p| format!("{:.1},{:.1}", place(p.0, x, SIZE.0), SIZE.1 - place(p.1, y, SIZE.1)))
        .collect();
    format!(
        "<svg class=\"spark\" width=\"150\" height=\"20\" viewBox=\"0 0 150 20\" role=\"presentation\">\
         <polyline points=\"{}\"/></svg>",
        line.join(" ")
    )
}

/// A chart with its title, its legend and what is said about it.
pub fn chart(chart: &Chart, caption: &str) -> String {
    // Title and legend stand in the page, where they cannot lie over a line.
    let series = chart.series.iter().map(|s| Series { name: String::new(), ..s.clone() });
    let bare = Chart {
        title: String::new(),
        x: printable(&chart.x),
        y: printable(&chart.y),
        series: series.collect(),
    };
    let drawn = match bare.svg(CHART.0, CHART.1) {
        Ok(svg) => themed(&svg),
        Err(error) => format!("<p class=\"warning\">{}</p>", escape(&error.to_string())),
    };
    let names: String = chart.series.iter().enumerate().map(|(i, s)| legend(i, s)).collect();
    let caption = match caption {
        "" => String::new(),
        text => format!("<p>{}</p>", escape(text)),
    };
    format!(
        "<figure><figcaption><b>{}</b><span class=\"legend\">{names}</span></figcaption>{drawn}{caption}</figure>",
        escape(&chart.title)
    )
}

/// What a series looks like, and its name.
fn legend(number: usize, series: &Series) -> String {
    if series.name.is_empty() {
        return String::new();
    }
    let colour = svg_colour(number);
    let mark = match series.style {
        Style::Dots => format!("<circle cx=\"11\" cy=\"5\" r=\"3\" fill=\"{colour}\"/>"),
        Style::Dashed => {
            format!("<path d=\"M0 5H22\" stroke=\"{colour}\" stroke-width=\"1.5\" stroke-dasharray=\"6 4\"/>")
        }
        Style::Line | Style::Steps => format!("<path d=\"M0 5H22\" stroke=\"{colour}\" stroke-width=\"2\"/>"),
    };
    format!(
        "<span><svg width=\"22\" height=\"10\" viewBox=\"0 0 22 10\">{mark}</svg> {}</span> ",
        escape(&series.name)
    )
}

fn svg_colour(number: usize) -> String {
    match colour(number) {
        [0, 0, 0] => "var(--ink)".to_owned(),
        [r, g, b] => format!("#{r:02X}{g:02X}{b:02X}"),
    }
}

/// Black and white of a drawing become ink and paper of the page. A drawing within HTML needs no name space.
pub fn themed(svg: &str) -> String {
    svg.replace(" xmlns=\"http://www.w3.org/2000/svg\"", "")
        .replace("\"#FFFFFF\"", "\"var(--paper)\"")
        .replace("\"#000000\"", "\"var(--ink)\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_line_stays_in_its_box() {
        let drawn = spark(&[(0.0, -1e300), (1.0, f64::NAN), (2.0, 1e300), (3.0, 0.0)]);
        let line = drawn.split('"').find(|t| t.contains(',')).unwrap();
        for number in line.split([' ', ',']) {
            assert!((0.0..=150.0).contains(&number.parse::<f64>().unwrap()), "{drawn}");
        }
        assert_eq!((spark(&[]), spark(&[(0.0, 1.0)])), (String::new(), String::new()));
    }

    #[test]
    fn a_chart_takes_the_colours_of_the_page_and_names_its_series_once() {
        let line = |name: &str| Series {
            name: name.into(),
            points: vec![(0.0, 0.0), (1.0, 1.0)],
            style: Style::Line,
        };
        let chart_of = Chart {
            title: "t".into(),
            x: "time, s".into(),
            y: "z, mm".into(),
            series: vec![line("alpha"), line("beta")],
        };
        let html = chart(&chart_of, "");
        assert_eq!((html.matches("alpha").count(), html.matches("beta").count()), (1, 1));
        assert!(html.contains("var(--ink)") && !html.contains("#000000") && !html.contains("xmlns"));
        assert!(html.contains("time, s") && html.contains("z, mm"));
    }
}
