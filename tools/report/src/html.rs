//! Sections as one self-contained HTML page, with its style, drawings and pictures.

use std::fmt::Write;

use super::drawings::{chart, spark};
use super::escape::escape;
use super::page::{Block, Cell, Mood, Picture, Section, Table, Tile};
use super::picture::base64;

const STYLE: &str = include_str!("page.css");

/// The page: a title, what it is about, the sections in their order.
pub fn page(title: &str, about: &str, sections: &[Section]) -> String {
    let (title, about) = (escape(title), escape(about));
    let mut contents = String::new();
    let mut body = String::new();
    for section in sections.iter().filter(|s| s.missing.is_none()) {
        let heading = escape(section.title);
        let _ = writeln!(contents, "<li><a href=\"#{}\">{heading}</a></li>", section.id);
        let _ = writeln!(body, "<section id=\"{}\">\n<h2>{heading}</h2>", section.id);
        blocks(&section.blocks, &mut body);
        body.push_str("</section>\n");
    }
    let missing: String = sections
        .iter()
        .filter_map(|s| {
            Some(format!("<dt>{}</dt><dd>{}</dd>\n", escape(s.title), escape(s.missing.as_deref()?)))
        })
        .collect();
    if !missing.is_empty() {
        contents.push_str("<li><a href=\"#missing\">Not in this session</a></li>\n");
        let _ = write!(
            body,
            "<section id=\"missing\">\n<h2>Not in this session</h2>\n<dl>\n{missing}</dl>\n</section>\n"
        );
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n\
         <body>\n<nav>\n<p>{title}</p>\n<ol>\n{contents}</ol>\n</nav>\n<main>\n\
         <header>\n<h1>{title}</h1>\n<p>{about}</p>\n</header>\n{body}</main>\n</body>\n</html>\n"
    )
}

fn blocks(blocks: &[Block], out: &mut String) {
    let mut group = "";
    for block in blocks {
        // Charts and pictures that follow each other stand side by side where there is room.
        let next = match block {
            Block::Chart(..) => "charts",
            Block::Picture(_) => "pictures",
            Block::Stack { .. } => "stacks",
            _ => "",
        };
        if next != group {
            out.push_str(if group.is_empty() { "" } else { "</div>\n" });
            if !next.is_empty() {
                let _ = writeln!(out, "<div class=\"{next}\">");
            }
            group = next;
        }
        block_to(block, out);
    }
    out.push_str(if group.is_empty() { "" } else { "</div>\n" });
}

fn block_to(block: &Block, out: &mut String) {
    let _ = match block {
        Block::Heading(text) => writeln!(out, "<h3>{}</h3>", escape(text)),
        Block::Text(text) => writeln!(out, "<p>{}</p>", escape(text)),
        Block::Warning(text) => writeln!(out, "<p class=\"warning\">{}</p>", escape(text)),
        Block::Tiles(tiles) => {
            writeln!(out, "<div class=\"tiles\">{}</div>", tiles.iter().map(tile).collect::<String>())
        }
        Block::Table(t) => writeln!(out, "{}", table(t)),
        Block::Chart(c, caption) => writeln!(out, "{}", chart(c, caption)),
        Block::Picture(p) => writeln!(out, "{}", picture(p)),
        Block::Drawing(svg, caption) => {
            writeln!(
                out,
                "<figure class=\"drawing\">{svg}<figcaption>{}</figcaption></figure>",
                escape(caption)
            )
        }
        Block::Stack { title, drawings, first } => writeln!(out, "{}", stack(title, drawings, *first)),
        Block::Listing { title, text } => {
            writeln!(
                out,
                "<details><summary>{}</summary><pre>{}</pre></details>",
                escape(title),
                escape(text)
            )
        }
    };
}

/// Needs no script and no scrolling: a mark for each drawing, of which one is chosen; arrow keys go through them. Browsers do
/// not bring back what a reader chose before, so the page always opens on the same drawing.
fn stack(title: &str, drawings: &[(String, String)], first: usize) -> String {
    let slide = |(number, (svg, caption)): (usize, &(String, String))| {
        let (class, chosen) = if number == first { ("slide first", " checked") } else { ("slide", "") };
        let (name, caption) = (escape(title), escape(caption));
        format!(
            "<input type=\"radio\" name=\"{name}\" title=\"{caption}\" aria-label=\"{caption}\" autocomplete=\"off\"{chosen}>\
             <div class=\"{class}\">{svg}<p>{caption}</p></div>\n"
        )
    };
    let slides: String = drawings.iter().enumerate().map(slide).collect();
    format!(
        "<figure class=\"stack\"><figcaption><b>{}</b></figcaption>\n<div class=\"slides\">\n{slides}</div></figure>",
        escape(title)
    )
}

fn class(mood: Mood) -> &'static str {
    match mood {
        Mood::Plain => "plain",
        Mood::Good => "good",
        Mood::Bad => "bad",
    }
}

fn tile(tile: &Tile) -> String {
    let (class, name, value) = (class(tile.mood), escape(&tile.name), escape(&tile.value));
    format!("<div class=\"tile {class}\"><span>{name}</span><strong>{value}</strong></div>")
}

fn table(table: &Table) -> String {
    let is_number = |column: usize| {
        table.rows.iter().all(|row| !matches!(row.get(column), Some(Cell::Text(_))))
            && table.rows.iter().any(|row| matches!(row.get(column), Some(Cell::Number(_) | Cell::Bar(..))))
    };
    let mut head = String::new();
    for (i, name) in table.columns.iter().enumerate() {
        let class = if is_number(i) { " class=\"number\"" } else { "" };
        let _ = write!(head, "<th scope=\"col\"{class}>{}</th>", escape(name));
    }
    let rows: String = table
        .rows
        .iter()
        .map(|row| format!("<tr>{}</tr>\n", row.iter().map(cell).collect::<String>()))
        .collect();
    let caption = match table.caption.as_str() {
        "" => String::new(),
        text => format!("<caption>{}</caption>", escape(text)),
    };
    format!(
        "<div class=\"wide\"><table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>"
    )
}

fn cell(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => format!("<td>{}</td>", escape(text)),
        Cell::Number(text) => format!("<td class=\"number\">{}</td>", escape(text)),
        Cell::State(mood, text) => format!("<td class=\"{}\">{}</td>", class(*mood), escape(text)),
        Cell::Spark(points) => format!("<td>{}</td>", spark(points)),
        Cell::Bar(part, text) => {
            let part = if part.is_finite() { part.clamp(0.0, 1.0) * 60.0 } else { 0.0 };
            format!(
                "<td class=\"number\">{} <svg class=\"bar\" width=\"60\" height=\"9\" viewBox=\"0 0 60 9\" \
                 role=\"presentation\"><rect width=\"{part:.1}\" height=\"9\"/></svg></td>",
                escape(text)
            )
        }
    }
}

fn picture(picture: &Picture) -> String {
    let [width, height] = picture.size;
    format!(
        "<figure><img width=\"{width}\" height=\"{height}\" alt=\"{}\" src=\"data:image/png;base64,{}\">\
         <figcaption>{}</figcaption></figure>",
        escape(&picture.alt),
        base64(&picture.png),
        escape(&picture.caption)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{Chart, Series, Style};

    #[test]
    fn text_is_text_wherever_it_stands() {
        let nasty = "<script>alert('x')</script> & \"q\" \u{7}";
        let chart_of = Chart {
            title: nasty.into(),
            x: nasty.into(),
            y: nasty.into(),
            series: vec![Series {
                name: nasty.into(),
                points: vec![(0.0, 1.0), (1.0, 2.0)],
                style: Style::Line,
            }],
        };
        let mut t = Table::new(nasty, &[nasty]);
        t.row([
            Cell::text(nasty),
            Cell::number(nasty),
            Cell::Bar(0.5, nasty.into()),
            Cell::State(Mood::Bad, nasty.into()),
        ]);
        let section = Section::new("id", "title", &())
            .unwrap()
            .with(Block::Heading(nasty.into()))
            .with(Block::Text(nasty.into()))
            .with(Block::Warning(nasty.into()))
            .with(Block::Tiles(vec![Tile::plain(nasty, nasty)]))
            .with(Block::Table(t))
            .with(Block::Chart(chart_of, nasty.into()))
            .with(Block::Picture(Picture {
                png: vec![1, 2],
                size: [1, 1],
                alt: nasty.into(),
                caption: nasty.into(),
            }))
            .with(Block::Stack {
                title: nasty.into(),
                drawings: vec![("<svg></svg>".into(), nasty.into())],
                first: 0,
            })
            .with(Block::Listing { title: nasty.into(), text: nasty.into() });
        let html = page(nasty, nasty, &[section]);
        assert!(!html.contains("<script") && !html.contains("alert('x')") && !html.contains('\u{7}'));
        assert!(html.matches("&lt;script&gt;").count() > 12);
        assert!(!html.contains("http:") && !html.contains("https:") && !html.contains("url("));
    }

    #[test]
    fn a_stack_opens_on_its_first_drawing_in_every_browser() {
        let drawings = ["a", "b", "c"].map(|name| (format!("<svg id=\"{name}\"></svg>"), name.to_owned()));
        let html = stack("axial slices", &drawings, 1);
        assert_eq!(html.matches("type=\"radio\"").count(), 3);
        assert_eq!(html.matches(" checked>").count(), 1);
        let chosen = html.split(" checked>").nth(1).unwrap();
        assert!(chosen.starts_with("<div class=\"slide first\"><svg id=\"b\">"), "{chosen}");
        // It does not rely on a scroll position, which browsers keep or do not know how to set.
        assert!(!STYLE.contains("scroll-initial-target") && !STYLE.contains("scroll-snap"));
        assert!(STYLE.contains("input:checked + .slide { display: flex; }"));
    }

    #[test]
    fn a_column_of_numbers_has_its_heading_over_them() {
        let mut t = Table::new("", &["what", "how much"]);
        t.row([Cell::text("a"), Cell::number("1")]);
        let html = table(&t);
        assert!(
            html.contains("<th scope=\"col\">what")
                && html.contains("<th scope=\"col\" class=\"number\">how much")
        );
    }
}
