//! The scene's settings for readers: words, and numbers with units.

use super::svg::escaped;
use needle_core::scene::{Scene, Word as _};
use std::fmt::Write as _;

/// Key suffixes that name a unit; a suffix that contains another one at its end comes first.
const UNITS: [(&str, &str); 13] = [
    ("_kg_per_m3", "kg/m³"),
    ("_n_per_m", "N/m"),
    ("_m_per_s2", "m/s²"),
    ("_m_per_s", "m/s"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_pa", "Pa"),
    ("_hz", "Hz"),
    ("_kg", "kg"),
    ("_n", "N"),
    ("_s", "s"),
    ("_m", "m"),
    ("_j", "J"),
];

/// HTML of the settings, one group per table of the scene; empty if the text is not valid TOML.
pub(super) fn settings_html(scene_toml: &str) -> String {
    let Ok(scene) = scene_toml.parse::<toml::Table>() else { return String::new() };
    let model = Scene::from_toml(scene_toml, "the run's scene").ok();
    let mut html = String::new();
    let own: toml::Table = scene.iter().filter(|(_, v)| !nested(v)).map(|(k, v)| (k.clone(), v.clone())).collect();
    group(&mut html, "scene", &own);
    for (name, value) in &scene {
        match value {
            toml::Value::Table(table) if name == "discretisation" => {
                group(
                    &mut html,
                    name,
                    &model.as_ref().map_or_else(|| table.clone(), |model| with_chosen(table, model)),
                );
            }
            toml::Value::Table(table) => group(&mut html, name, table),
            toml::Value::Array(items) if nested(value) => {
                for (i, item) in items.iter().filter_map(toml::Value::as_table).enumerate() {
                    group(&mut html, &format!("{name} {}", i + 1), item);
                }
            }
            _ => {}
        }
    }
    html
}

/// A scene's discretisation with what the program chose in place of `auto` and 0.
fn with_chosen(table: &toml::Table, scene: &Scene) -> toml::Table {
    let grading = scene.grading();
    let digits = |value: f64| format!("{value:.3e}").parse().unwrap_or(value);
    let number = |value: Option<f64>| value.map(|value| text(&toml::Value::Float(digits(value))));
    let chosen = |key: &str| match key {
        "spacing_m" => number(grading.map(|g| g.spacing.get())),
        "edge_refinement" => number(grading.map(|g| g.edge_refinement)),
        "growth" => number(grading.map(|g| g.growth)),
        "support_factor" => number(Some(scene.support_factor())),
        "cells_per_point" => Some(scene.cells_per_point().to_string()),
        "volume_ratio" => Some(scene.volume_ratio_in(scene.dimension().dimension).as_str().to_owned()),
        "dimension" => Some(scene.dimension().dimension.as_str().to_owned()),
        "integration" => {
            let consistent = scene.is_consistent_in(scene.dimension().dimension);
            Some(if consistent { "consistent" } else { "plain" }.to_owned())
        }
        _ => None,
    };
    let left_open =
        |value: &toml::Value| value.as_str() == Some("auto") || ["0", "0.0"].contains(&value.to_string().as_str());
    let shown = |(key, value): (&String, &toml::Value)| {
        let own = if left_open(value) { chosen(key) } else { None };
        (key.clone(), own.map_or_else(|| value.clone(), |own| toml::Value::String(format!("auto: {own}"))))
    };
    table.iter().map(shown).collect()
}

fn nested(value: &toml::Value) -> bool {
    value.is_table() || value.as_array().is_some_and(|a| !a.is_empty() && a.iter().all(toml::Value::is_table))
}

fn group(html: &mut String, name: &str, table: &toml::Table) {
    // The description is shown at the top of the page.
    let rows: Vec<_> = table.iter().filter(|(key, _)| *key != "description").collect();
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(html, "<div><h3>{}</h3><dl>", escaped(&words(name)));
    for (key, value) in rows {
        let unit = UNITS.iter().find(|(ending, _)| key.ends_with(ending));
        let (key, unit) = unit.map_or((key.as_str(), ""), |(e, u)| (key.strip_suffix(e).unwrap_or(key), u));
        let shown = escaped(&text(value));
        let _ = writeln!(html, "<div><dt>{}</dt><dd>{shown} {unit}</dd></div>", escaped(&words(key)));
    }
    html.push_str("</dl></div>\n");
}

fn words(key: &str) -> String {
    key.replace('_', " ")
}

fn text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(s) => s.clone(),
        toml::Value::Array(items) => items.iter().map(text).collect::<Vec<_>>().join(", "),
        toml::Value::Table(t) => {
            t.iter().map(|(k, v)| format!("{} {}", words(k), text(v))).collect::<Vec<_>>().join(", ")
        }
        // 1e-6 instead of 0.000001; 970 instead of 970.0.
        toml::Value::Float(number) => format!("{number:?}").trim_end_matches(".0").to_owned(),
        other => other.to_string(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_a_scene_leaves_to_the_program_is_shown_with_what_it_chose() {
        let scene = Scene::preset("needle_insertion").unwrap().to_toml();
        let html = settings_html(&scene);
        for shown in ["<dd>auto: 0.00233 m</dd>", "<dd>auto: axisymmetric </dd>", "<dd>auto: 1.8 </dd>"] {
            assert!(html.contains(shown), "{shown}: {html}");
        }
    }
}
