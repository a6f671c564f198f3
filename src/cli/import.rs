//! `needle_twin import`: recordings of other programs as a bag.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::recorded::SourceOptions;
use super::summary::{screen, written};
use super::{CliError, Outcome, print, scene_file, warn};
use needle_recording::{Column, Extent, Import, Imported, Table, TopicNames};

/// Make a bag of tables (CSV, TSV, .xlsx, .npy, .npz), or of a bag with other topics and units
///
/// What is not said is seen from the text: the separator, the decimal comma, the headers, the columns of time, position and force,
/// and their units where the headers carry them. Position and force may be files of their own, each with its own clock.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Tables, or one bag
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,

    /// Folder of the bag to make; it must not exist, or be empty
    #[arg(long, value_name = "BAG", required_unless_present = "dry_run")]
    out: Option<PathBuf>,

    /// Column (or topic) of the force
    #[arg(long = "force", value_name = "COLUMN", conflicts_with = "force_topic", help_heading = "Recording")]
    force_column: Option<String>,

    #[command(flatten)]
    sources: SourceOptions,

    /// Scene that the bag names
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: Option<String>,

    /// Only show what was understood
    #[arg(long)]
    dry_run: bool,

    /// Print it as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    if let Some(scene) = &arguments.scene {
        scene_file::load(scene)?;
    }
    let mut sources = arguments.sources.clone();
    sources.force_topic = sources.force_topic.or_else(|| arguments.force_column.clone());
    let said = sources.selection(TopicNames::default());
    let import = Import::open(&arguments.files, &said)?;
    import.told().warnings.iter().for_each(|text| warn(text));
    let bag = arguments.out.as_deref().filter(|_| !arguments.dry_run);
    let import = import.write(bag, arguments.scene.as_deref())?;
    import.told.losses.iter().for_each(|loss| warn(&loss.to_string()));
    let files: Vec<PathBuf> = import.written.iter().map(|made| made.folder.clone()).collect();
    print(&if arguments.json { json_of(&import, &files) } else { text_of(&import, &files) })?;
    Ok(if import.told.losses.is_empty() { Outcome::Complete } else { Outcome::Lossy })
}

/// Each column with what it is taken for.
fn columns(table: &Table) -> Vec<(&'static str, &Column)> {
    let of = &table.columns;
    let time = of.time.as_ref().map(|(column, _)| column);
    let one = [("time", time), ("position", of.position.as_ref()), ("force", of.force.as_ref())];
    let mut all: Vec<_> = one.into_iter().filter_map(|(what, column)| column.map(|c| (what, c))).collect();
    all.extend(of.pose.iter().flat_map(|pose| ["x", "y", "z"].into_iter().zip(pose)));
    all.extend(of.orientation.iter().flat_map(|axis| ["qx", "qy", "qz", "qw"].into_iter().zip(axis)));
    all.extend(of.forces.iter().flat_map(|force| ["force x", "force y", "force z"].into_iter().zip(force)));
    all
}

fn text_of(import: &Imported, files: &[PathBuf]) -> String {
    let mut lines = Vec::new();
    for table in &import.tables {
        lines.push(("table", format!("{}: {}, {} rows", table.file, table.layout, table.rows)));
        for (what, column) in columns(table) {
            let Column { index, name, unit, scale, zero } = column;
            let sign = if *scale < 0.0 { ", sign turned" } else { "" };
            let zero = if *zero == 0.0 { String::new() } else { format!(", counted from {zero}") };
            lines.push((what, format!("column {} `{name}`, in {unit}{zero}{sign}", index + 1)));
        }
    }
    for Extent { what, samples, from_to_s: [a, b], range: [low, high], unit } in &import.extents {
        let [low, high] = [low + 0.0, high + 0.0]; // no -0
        lines.push((what, format!("{samples} readings from {a:.3} to {b:.3} s, from {low:.6} to {high:.6} {unit}")));
    }
    lines.extend(files.first().map(|first| ("bag", written(first, files))));
    let mut text = screen(&lines);
    if files.is_empty() {
        let _ = writeln!(text, "dry run: nothing was written"); // a String takes anything
    }
    text
}

fn json_of(import: &Imported, files: &[PathBuf]) -> String {
    let column = |(what, c): (&str, &Column)| json!({ "what": what, "column": c.index + 1, "header": c.name, "unit": c.unit, "si_per_unit": c.scale, "zero": c.zero });
    let table = |t: &Table| {
        let taken: Vec<Value> = columns(t).into_iter().map(column).collect();
        json!({ "file": t.file, "layout": t.layout, "rows": t.rows, "rows_without_numbers": t.bad, "columns": taken })
    };
    let series = import.extents.iter().map(|e| {
        json!({ "what": e.what, "readings": e.samples, "from_s": e.from_to_s[0], "to_s": e.from_to_s[1],
                "least": e.range[0], "largest": e.range[1], "unit": e.unit })
    });
    let value = json!({
        "tables": import.tables.iter().map(table).collect::<Vec<_>>(),
        "series": Value::from_iter(series),
        "bag": files.first().map(|f| f.display().to_string()),
        "losses": import.told.losses.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "warnings": import.told.warnings,
    });
    format!("{value:#}\n")
}
