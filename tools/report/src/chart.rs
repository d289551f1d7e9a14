//! Charts as SVG text, for reports and plans.

use plotters::coord::Shift;
use plotters::prelude::*;
use serde::Serialize;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// A line from point to point.
    Line,
    /// A thin line of dashes: a target, a truth, a limit.
    Dashed,
    /// A dot for each point.
    Dots,
    /// A value that stands until the next one.
    Steps,
}

/// Numbers of one thing over x. A point with a NaN breaks the line.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// What the legend says.
    pub name: String,
    /// (x, y), x rising.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub style: Style,
}

/// A chart of series over one pair of axes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Chart {
    pub title: String,
    /// What x is, with its unit.
    pub x: String,
    /// What y is, with its unit.
    pub y: String,
    /// What is drawn, the first below.
    pub series: Vec<Series>,
}

/// Where the legend is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Legend {
    Over,
    Aside,
}

/// Colours that people with weak red-green sight can tell apart (Okabe and Ito).
const COLOURS: [RGBColor; 10] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(150, 150, 150),
    RGBColor(140, 90, 60),
    RGBColor(150, 190, 0),
];

/// Red, green, blue of the series of this number, for whoever draws its name elsewhere.
pub fn colour(number: usize) -> [u8; 3] {
    let RGBColor(r, g, b) = COLOURS[number % COLOURS.len()];
    [r, g, b]
}

/// Why a chart is not drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the chart \"{title}\" cannot be drawn: {error}")]
pub struct ChartError {
    title: String,
    error: String,
}

impl Chart {
    /// The chart as an SVG document of this size in pixels, or what is wrong with its numbers.
    pub fn svg(&self, width: u32, height: u32) -> Result<String, ChartError> {
        let colours: Vec<usize> = (0..self.series.len()).collect();
        self.document((width, height), |area| self.draw(area, &colours, Legend::Over))
    }

    /// The same with its legend on the right, and a colour for each series, by number: series of one colour belong
    /// together, and one without a name is not in the legend.
    pub fn svg_with_legend_aside(
        &self,
        width: u32,
        height: u32,
        colours: &[usize],
    ) -> Result<String, ChartError> {
        let longest = self.series.iter().map(|s| s.name.chars().count()).max().unwrap_or(0) as u32;
        let legend = (44 + 7 * longest).min(width / 2);
        self.document((width, height), |area| {
            area.fill(&WHITE)?;
            let (left, right) = area.split_horizontally(width - legend);
            self.draw(&left, colours, Legend::Aside)?;
            let named = self.series.iter().zip(colours).filter(|(s, _)| !s.name.is_empty());
            for (place, (series, colour)) in named.enumerate() {
                let (y, colour) = (40 + 20 * place as i32, COLOURS[colour % COLOURS.len()]);
                let line = [(2, y), (22, y)];
                match series.style {
                    Style::Dots => right.draw(&Circle::new((12, y), 3, colour.filled()))?,
                    _ => right.draw(&PathElement::new(line, colour.stroke_width(2)))?,
                }
                let text = ("sans-serif", 12).into_font();
                right.draw(&Text::new(series.name.clone(), (28, y - 6), text))?;
            }
            Ok(())
        })
    }

    fn document(
        &self,
        size: (u32, u32),
        draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), DrawingAreaErrorKind<std::io::Error>>,
    ) -> Result<String, ChartError> {
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present())
            .map_err(|error| ChartError { title: self.title.clone(), error: error.to_string() })?;
        drop(area);
        Ok(text)
    }

    fn draw(
        &self,
        area: &DrawingArea<SVGBackend<'_>, Shift>,
        colours: &[usize],
        legend: Legend,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        area.fill(&WHITE)?;
        let (x, y) = (self.range(|p| p.0), self.range(|p| p.1));
        let mut builder = ChartBuilder::on(area);
        if !self.title.is_empty() {
            builder.caption(&self.title, ("sans-serif", 16));
        }
        let mut chart = builder
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(58)
            .build_cartesian_2d(x.0..x.1, y.0..y.1)?;
        let label = |v: &f64| number(*v);
        chart
            .configure_mesh()
            .x_desc(&self.x)
            .y_desc(&self.y)
            .light_line_style(WHITE)
            .x_label_formatter(&label)
            .y_label_formatter(&label)
            .draw()?;
        for (series, colour) in self.series.iter().zip(colours) {
            let colour = &COLOURS[colour % COLOURS.len()];
            let style = colour.stroke_width(if series.style == Style::Dashed { 1 } else { 2 });
            match series.style {
                Style::Dots => {
                    let dots = series.points.iter().filter(|p| finite(p));
                    chart
                        .draw_series(dots.map(|p| Circle::new(*p, 2, colour.filled())))?
                        .label(&series.name)
                        .legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
                    continue;
                }
                Style::Dashed => {
                    for part in unbroken(&series.points) {
                        chart.draw_series(DashedLineSeries::new(part.iter().copied(), 6, 4, style))?;
                    }
                }
                Style::Line | Style::Steps => {
                    for part in unbroken(&series.points) {
                        let part = if series.style == Style::Steps { steps(part) } else { part.to_vec() };
                        chart.draw_series(LineSeries::new(part, style))?;
                    }
                }
            }
            if series.name.is_empty() || legend == Legend::Aside {
                continue;
            }
            chart
                .draw_series(std::iter::empty::<Circle<(f64, f64), i32>>())?
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        if legend == Legend::Over && self.series.iter().any(|s| !s.name.is_empty()) {
            chart
                .configure_series_labels()
                .border_style(BLACK.mix(0.3))
                .background_style(WHITE.mix(0.85))
                .draw()?;
        }
        Ok(())
    }

    /// Smallest and largest finite value, with a margin; 0 to 1 where there is none.
    fn range(&self, of: impl Fn(&(f64, f64)) -> f64) -> (f64, f64) {
        let points = self.series.iter().flat_map(|s| &s.points).filter(|p| finite(p));
        let (low, high) =
            points.map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return (0.0, 1.0);
        }
        // Ticks closer than numbers of this size can be apart would never come to an end.
        let largest = low.abs().max(high.abs());
        let margin = match high - low {
            width if width <= 1e-9 * largest => largest.max(1.0) * 0.05,
            width => width * 0.04,
        };
        (low - margin, high + margin)
    }
}

/// Beyond this no number is one that anybody measured, and axes lose their digits.
const LARGEST: f64 = 1e15;

fn finite(p: &(f64, f64)) -> bool {
    p.0.abs() < LARGEST && p.1.abs() < LARGEST
}

/// The runs of finite points.
fn unbroken(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.split(|p| !finite(p)).filter(|part| !part.is_empty())
}

/// The corners of a line that stays at each value until the next one.
fn steps(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let held = points.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]);
    held.chain(points.last().copied()).collect()
}

/// A number of an axis, as short as it can be.
fn number(v: f64) -> String {
    if v == 0.0 || v.abs() < 1e-12 {
        return "0".to_owned();
    }
    if v.abs() >= 1e5 || v.abs() < 1e-3 {
        return format!("{v:.1e}");
    }
    let text = format!("{v:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_is_an_svg_with_its_words_and_without_what_is_not_finite() {
        let chart = Chart {
            title: "Height".into(),
            x: "time, s".into(),
            y: "z, mm".into(),
            series: [Style::Line, Style::Dashed, Style::Dots, Style::Steps]
                .map(|style| Series {
                    name: format!("{style:?}"),
                    points: vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0), (3.0, 2.0)],
                    style,
                })
                .to_vec(),
        };
        let svg = chart.svg(640, 320).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for word in ["Height", "time, s", "z, mm", "Line", "Dashed", "Dots", "Steps"] {
            assert!(svg.contains(word), "{word}");
        }
        assert!(!svg.contains("NaN"));
        assert_eq!(svg.matches("<circle").count(), 4, "three dots and one in the legend");
    }

    #[test]
    fn numbers_at_the_end_of_their_digits_are_drawn_and_come_to_an_end() {
        for values in [[1e9, 1e9 + 2e-7], [0.1 + 0.2, 0.3], [1e300, -1e300], [5e-324, 0.0], [1e-20, 2e-20]] {
            let series = Series {
                name: String::new(),
                points: vec![(0.0, values[0]), (1.0, values[1])],
                style: Style::Line,
            };
            assert!(Chart { series: vec![series], ..Chart::default() }.svg(200, 100).is_ok(), "{values:?}");
        }
    }

    #[test]
    fn a_legend_beside_is_in_the_same_document_and_has_the_named_series() {
        let series =
            |name: &str, style| Series { name: name.into(), points: vec![(0.0, 1.0), (1.0, 2.0)], style };
        let chart = Chart {
            series: vec![
                series("Rectum", Style::Line),
                series("", Style::Dashed),
                series("Bladder", Style::Dots),
            ],
            ..Chart::default()
        };
        let svg = chart.svg_with_legend_aside(640, 320, &[0, 0, 1]).unwrap();
        assert_eq!((svg.matches("<svg").count(), svg.matches("</svg>").count()), (1, 1));
        assert!(svg.trim_end().ends_with("</svg>") && svg.contains("Rectum") && svg.contains("Bladder"));
    }

    #[test]
    fn a_chart_of_nothing_is_drawn_too() {
        assert!(Chart::default().svg(200, 100).unwrap().contains("<svg"));
    }
}
