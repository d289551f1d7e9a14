//! Pages in the browsers that are installed.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use stillpoint_report::html;
use stillpoint_report::page::{Block, Section};

/// Colours of the drawings; the page is to open on the second.
const COLOURS: [(&str, [u8; 3]); 3] =
    [("#ff0000", [255, 0, 0]), ("#0000ff", [0, 0, 255]), ("#00ff00", [0, 255, 0])];

/// Pixels of each colour in what a browser shows of the page.
fn shown(picture: &Path) -> [usize; 3] {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(picture).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    let channels = frame.color_type.samples();
    COLOURS.map(|(_, colour)| {
        bytes[..frame.buffer_size()].chunks(channels).filter(|pixel| pixel[..3] == colour).count()
    })
}

#[test]
fn a_page_of_slices_opens_on_its_first_slice_in_every_installed_browser() {
    let folder = tempfile::tempdir().unwrap();
    let drawing = |(number, (colour, _)): (usize, &(&str, _))| {
        let rect = format!("<rect width=\"10\" height=\"10\" fill=\"{colour}\"/>");
        (format!("<svg viewBox=\"0 0 10 10\">{rect}</svg>"), format!("slice {number}"))
    };
    let drawings: Vec<(String, String)> = COLOURS.iter().enumerate().map(drawing).collect();
    let mut section = Section::new("dose", "Dose", &Value::Null).unwrap();
    for title in ["axial slices", "coronal slices"] {
        section =
            section.with(Block::Stack { title: title.to_owned(), drawings: drawings.clone(), first: 1 });
    }
    let page = folder.path().join("page.html");
    std::fs::write(&page, html::page("slices", "a test", &[section])).unwrap();
    let url = format!("file://{}", page.display());
    let profile = folder.path().join("profile");
    std::fs::create_dir(&profile).unwrap();
    let mut tried = 0;
    for browser in ["firefox", "chromium"] {
        let picture = folder.path().join(format!("{browser}.png"));
        let mut command = Command::new(browser);
        command.args(["--headless", "--window-size=1200,1600"]);
        match browser {
            "firefox" => {
                command.arg("--no-remote").arg("--profile").arg(&profile).arg("--screenshot").arg(&picture)
            }
            _ => command
                .args(["--no-sandbox", "--disable-gpu", "--hide-scrollbars"])
                .arg(format!("--user-data-dir={}", profile.join(browser).display()))
                .arg(format!("--screenshot={}", picture.display())),
        };
        let Ok(out) = command.arg(&url).output() else {
            println!("skipped: {browser} is not installed");
            continue;
        };
        assert!(picture.is_file(), "{browser}: {}", super::text(&out.stderr));
        let [before, first, after] = shown(&picture);
        assert!(first > 10_000, "{browser} shows {first} pixels of the first slice");
        assert_eq!((before, after), (0, 0), "{browser} shows another slice");
        tried += 1;
    }
    println!("{tried} browsers");
}
