//! Tables of Parquet, read by another program. `STILLPOINT_PYTHON` names a Python that has pyarrow.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::process::Command;

use arrow_array::Array;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, UInt64Type};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, Sample, Track};

use crate::export::{export, recorded};
use crate::{stillpoint, text};

#[test]
fn a_table_of_parquet_has_the_bits_of_every_sample() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let arguments = ["fused.state", "--format", "parquet"];
    for out in ["a", "b"] {
        export(folder.path(), &session, &[&arguments[..], &["--out", out]].concat());
    }
    let file = folder.path().join("a/fused.state.parquet");
    assert_eq!(
        std::fs::read(&file).unwrap(),
        std::fs::read(folder.path().join("b/fused.state.parquet")).unwrap()
    );
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(&file).unwrap()).unwrap();
    let schema = reader.schema().clone();
    assert_eq!(schema.metadata()["topic"], "fused.state");
    let height = schema.field_with_name("position.z").unwrap();
    assert_eq!((height.data_type(), &*height.metadata()["unit"]), (&DataType::Float64, "m"));
    let opened = Session::open(&session).unwrap();
    let mut samples = opened.samples_where(|t| t.name == "fused.state").map(|s| s.unwrap().sample);
    let mut count = 0;
    for batch in reader.build().unwrap() {
        let batch = batch.unwrap();
        let [sequence, heights] = ["sequence", "position.z"].map(|name| batch.column_by_name(name).unwrap());
        let heights = heights.as_primitive::<Float64Type>();
        for row in 0..batch.num_rows() {
            let sample = samples.next().unwrap();
            let pieces = Pieces::split(Track::KIND, &sample).unwrap();
            assert_eq!(sequence.as_primitive::<UInt64Type>().value(row), pieces.header().sequence);
            let height = pieces.view::<Track>().unwrap().first().unwrap().position[2];
            assert_eq!((heights.is_null(row), heights.value(row).to_bits()), (false, height.to_bits()));
            count += 1;
        }
    }
    assert!(count > 20 && samples.next().is_none(), "{count} rows");
}

/// Compares each table with the one of CSV in the next folder, cell by cell, and prints the metadata of columns.
const COMPARE: &str = r#"
import csv, json, pathlib, struct, sys
import pyarrow.parquet as pq
bits = lambda x: struct.pack('<d', float(x))
cells, columns = 0, {}
for file in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    table = pq.read_table(file)
    rows = list(csv.reader(open(pathlib.Path(sys.argv[2]) / (file.stem + '.csv'), newline='')))
    assert len(rows) == table.num_rows + 1, file
    for number, field in enumerate(table.schema):
        meta = {k.decode(): v.decode() for k, v in (field.metadata or {}).items() if not k.startswith(b'PARQUET:')}
        columns[f'{file.stem}:{field.name}'] = {'type': str(field.type), **meta}
        for value, row in zip(table.column(number).to_pylist(), rows[1:]):
            text = row[number]
            if value is None: same = text == ''
            elif isinstance(value, list): same = [bits(v) for v in value] == [bits(t) for t in text.split(' ')]
            elif isinstance(value, str): same = value == text
            elif isinstance(value, int): same = value == int(text)
            else: same = bits(value) == bits(text) or value != value and text == 'NaN'
            assert same, (file, field.name, value, text)
            cells += 1
print(json.dumps({'cells': cells, 'columns': columns}))
"#;

fn compared(
    folder: &Path,
    python: &str,
    session: &Path,
    arguments: &[&str],
) -> (u64, BTreeMap<String, Value>) {
    let out = tempfile::tempdir_in(folder).unwrap();
    for format in ["parquet", "csv"] {
        let to = out.path().join(format);
        let last = ["--format", format, "--out", to.to_str().unwrap()];
        export(folder, session, &[arguments, &last].concat());
    }
    let folders = ["parquet", "csv"].map(|format| out.path().join(format));
    let out = Command::new(python).args(["-c", COMPARE]).args(&folders).output().unwrap();
    assert!(out.status.success(), "{arguments:?}: {}", text(&out.stderr));
    let answer: Value = serde_json::from_slice(&out.stdout).unwrap();
    let columns = serde_json::from_value(answer["columns"].clone()).unwrap();
    (answer["cells"].as_u64().unwrap(), columns)
}

#[test]
fn pyarrow_reads_the_numbers_of_csv_with_types_units_and_codes() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import pyarrow.parquet"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import pyarrow (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let (cells, columns) = compared(folder.path(), &python, &session, &[]);
    assert!(cells > 1000, "{cells}");
    let column = |name: &str| &columns[name];
    assert_eq!(column("fused.state:position.z")["type"], "double");
    assert_eq!(column("fused.state:position.z")["unit"], "m");
    assert_eq!(column("fused.state:stamp_ns")["unit"], "ns");
    assert_eq!(column("fused.state:incarnation")["type"], "uint32");
    assert!(columns.values().any(|column| column.get("codes").is_some()), "{columns:?}");
    let (_, columns) = compared(
        folder.path(),
        &python,
        &session,
        &["fused.state", "--field", "covariance", "--field", "pose.pitch", "--after", "200 ms"],
    );
    assert!(columns["fused.state:covariance"]["type"].as_str().unwrap().starts_with("list<"), "{columns:?}");
    assert_eq!(columns["fused.state:pose.pitch"]["unit"], "rad");
    // Clouds have a row for each point, bare images one for each pixel.
    let out = stillpoint(folder.path(), &["replay", session.to_str().unwrap(), "--record", "all"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let all = folder.path().join("all");
    let (cells, columns) =
        compared(folder.path(), &python, &all, &["v2_face.face", "v2.depth", "--until", "100 ms"]);
    assert!(cells > 100_000, "{cells}");
    assert_eq!(columns["v2.depth:data"]["type"], "uint16");
}
