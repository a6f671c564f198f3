//! `report.html`: the run on one self-contained page.
//!
//! Text, figures and tables are in the page itself; its script draws the curves and the deformed sample.

use super::{
    ReportError, embed,
    force_plot::{force_plot, way},
    line_plot,
    settings::settings_html,
    strain,
    svg::escaped,
    tables,
};
use needle_estimate::compare::{Pass, Run};
use std::fmt::Write as _;

pub(super) const PAGE: &str = include_str!("../assets/report/page.html");
const STYLE: &str = include_str!("../assets/report/style.css");
const SCRIPTS: [&str; 5] = [
    include_str!("../assets/report/text.js"),
    include_str!("../assets/report/charts.js"),
    include_str!("../assets/report/shapes.js"),
    include_str!("../assets/report/view.js"),
    include_str!("../assets/report/main.js"),
];

/// Content of `report.html`: summary, force over depth and over time with residual, the deformed sample in 3D, steps
/// and latency, targets, stability, settings. It loads nothing, stays under 5 MB and follows the reader's light or
/// dark setting.
///
/// # Errors
/// [`ReportError::Length`] or [`ReportError::Index`] if fields and cells of the run don't fit its points.
pub fn report_html(run: &Run) -> Result<String, ReportError> {
    let data = embed::data(run)?;
    let drawn = !data["view"].is_null();
    // A name in the JSON may contain "</script>"; an escaped "<" is equivalent in JSON.
    let data = data.to_string().replace('<', "\\u003c");
    let title = format!("{}: {}", run.scene, if run.command.is_empty() { "run" } else { &run.command });
    let parts = [
        ("{{title}}", escaped(&title)),
        ("{{style}}", STYLE.to_owned()),
        ("{{body}}", body(run, drawn)),
        ("{{data}}", data),
        ("{{script}}", SCRIPTS.concat()),
    ];
    Ok(filled(PAGE, &parts))
}

/// The template with each placeholder replaced once, in order, so that inserted content is never taken for a
/// placeholder.
pub(super) fn filled(template: &str, parts: &[(&str, String)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    for (placeholder, content) in parts {
        if let Some((before, after)) = rest.split_once(placeholder) {
            page.push_str(before);
            page.push_str(content);
            rest = after;
        }
    }
    page.push_str(rest);
    page
}

fn body(run: &Run, drawn: bool) -> String {
    let mut html = String::new();
    header(&mut html, run);
    tables::verdict(&mut html, run);
    tables::cards(&mut html, run);
    let measured = run.answers.iter().any(|a| a.residual_n().is_some());
    let passes = run.passes();
    if drawn {
        html.push_str("<div class=\"pair\">\n");
    }
    let fallback = without_scripts(force_plot(run).to_svg());
    chart(
        &mut html,
        "force-depth",
        "Force over depth",
        "Against the motion of the tip; hover or tap to read.",
        &legend(measured, &passes, run.band_name()),
        &fallback,
    );
    if drawn {
        let stress = strain::moduli_pa(&run.scene_toml).map_or("", |_| STRESS);
        let region = if run.final_state.region.is_empty() { "" } else { REGION };
        html.push_str(&VIEW.replace("{{fields}}", &format!("{STRAIN}{stress}{region}")));
        html.push_str("</div>\n");
    }
    chart(
        &mut html,
        "force-time",
        "Force over time",
        "Shaded by phase. Click to show that moment of the sample.",
        &legend(measured, &[], run.band_name()),
        &without_scripts(line_plot::force(run)),
    );
    chart(
        &mut html,
        "cost",
        "Cost of each pose",
        "Explicit steps taken, and wall time from the pose's arrival to its answer. The dashed line is the time between poses.",
        "",
        &without_scripts(line_plot::cost(run)),
    );
    if !run.target_names.is_empty() && !run.targets.is_empty() {
        chart(
            &mut html,
            "targets",
            "Targets",
            "How far the tissue has taken each target.",
            &tables::target_legend(run),
            &(without_scripts(line_plot::targets(run)) + &tables::targets(run)),
        );
    }
    tables::baselines(&mut html, run);
    tables::stability(&mut html, run);
    settings(&mut html, run);
    footer(&mut html, run);
    html
}

/// A picture for browsers that do not run scripts.
fn without_scripts(picture: String) -> String {
    format!("<noscript>{picture}</noscript>")
}

fn header(html: &mut String, run: &Run) {
    let _ = writeln!(html, "<header>\n<h1>{}</h1>", escaped(&run.scene));
    for line in [run.description.as_str(), &measured_line(run)] {
        if !line.is_empty() {
            let _ = writeln!(html, "<p>{}</p>", escaped(line));
        }
    }
    html.push_str("</header>\n");
}

fn measured_line(run: &Run) -> String {
    match run.measured_source.as_str() {
        "" => "No measured force: this is a prediction alone.".to_owned(),
        source => format!("Measured force: {source}."),
    }
}

fn chart(html: &mut String, id: &str, heading: &str, about: &str, legend: &str, after: &str) {
    let _ = writeln!(
        html,
        "<section id=\"{id}\">\n<h2>{heading}</h2>\n<p>{about}</p>\n{legend}\n<p class=\"readout\" aria-live=\"off\"></p>\n\
         <div class=\"chart\"></div>\n{after}\n</section>"
    );
}

/// Names of the curves; with several passes, those of each.
fn legend(measured: bool, passes: &[Pass], band: &str) -> String {
    let entry = |colour: &str, class: &str, text: &str| {
        format!("<li><i class=\"{class}\" style=\"border-color:var(--{colour})\"></i>{text}</li>")
    };
    let mut items = Vec::new();
    items.push(entry("accent", "fan", band));
    // insertion and retraction of the first pass, then of the others
    let of = [
        ("predicted", ["accent", "accent-2", "again", "again-2"]),
        ("measured", ["measured", "measured-2", "measured-again", "measured-again-2"]),
    ];
    for (what, colours) in of.into_iter().take(1 + usize::from(measured)) {
        if passes.len() < 2 {
            items.push(entry(colours[0], "", what));
            continue;
        }
        for pass in passes.iter().filter(|pass| pass.number < 2) {
            let colour = colours[2 * pass.number.min(1) + usize::from(pass.back)];
            let dash = if what == "predicted" && (pass.back || pass.number > 0) { "dash" } else { "" };
            items.push(entry(colour, dash, &format!("{what}, {}", way(pass, passes))));
        }
    }
    format!("<ul class=\"legend\">{}</ul>", items.concat())
}

const STRAIN: &str = r#"<option value="strain">strain</option>"#;
const REGION: &str = r#"<option value="region">region</option>"#;
const STRESS: &str = r#"<option value="stress">von Mises stress</option>"#;

const VIEW: &str = r#"<section id="sample" class="view">
<h2>Deformed sample</h2>
<p>Drag to turn, pinch or use the wheel to zoom. Dotted: the undeformed outline.</p>
<div class="controls">
<select data-control="mode" aria-label="What to show"><option value="half">cut open</option><option value="whole">whole</option></select>
<select data-control="field" aria-label="Colour"><option value="displacement">displacement</option><option value="jacobian">volume ratio</option>{{fields}}</select>
<button type="button" data-control="mesh" aria-pressed="false">Mesh</button>
<button type="button" data-control="out" aria-label="Zoom out">−</button>
<button type="button" data-control="in" aria-label="Zoom in">+</button>
<button type="button" data-control="home">Reset</button>
</div>
<div><canvas tabindex="0" role="img" aria-label="Deformed sample in three dimensions; arrow keys turn it, plus and minus zoom"></canvas></div>
<div class="scale"><span></span><i></i><span></span><span></span></div>
<ul class="legend" data-show="regions" hidden></ul>
<div class="controls">
<button type="button" data-control="play">Play</button>
<label class="time"><input type="range" data-control="time" min="0" max="0" step="1" value="0" aria-label="Moment"><output data-show="moment"></output></label>
</div>
</section>
"#;

fn settings(html: &mut String, run: &Run) {
    let groups = settings_html(&run.scene_toml);
    if groups.is_empty() {
        return;
    }
    let _ = writeln!(
        html,
        "<section id=\"settings\">\n<h2>Scene</h2>\n<p>Every setting of this run.</p>\n<div class=\"settings\">\n{groups}</div>\n\
         <details><summary>As a scene file</summary><pre>{}</pre></details>\n</section>",
        escaped(&run.scene_toml)
    );
}

fn footer(html: &mut String, run: &Run) {
    let _ = writeln!(
        html,
        "<footer>needle_twin {}, checksum <code>{}</code>. Beside this page: metrics.json, force.csv, targets.csv, \
         final.vtu (ParaView), force.svg and force.png.</footer>",
        env!("CARGO_PKG_VERSION"),
        escaped(&run.checksum)
    );
}
