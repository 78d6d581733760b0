//! What a material was made from, and whether that is still there unchanged.

use crate::Failure;
use crate::commands::calibrate::Calibrated;
use crate::commands::import::SOURCES;
use crate::commands::solve::Convergence;
use crate::measurement::{self, INDEX};
use crate::output::counted;
use crate::report::again;
use crate::report::html::{escape, facts, utc};
use crate::session::FILE;
use crate::steps::Ledger;
use material::{Input, Material};

/// Everything that says how the session came to what it holds.
pub(crate) fn provenance(
    ledger: &Ledger<'_>,
    material: Option<&Material>,
    convergence: Option<&Convergence>,
    calibration: Option<&Calibrated>,
) -> Result<String, Failure> {
    let session = ledger.session;
    let mut out = match material {
        Some(material) => made(material),
        None => String::new(),
    };
    if let Some(material) = material {
        let lines = again::commands(session, material, convergence).join("\n");
        out += &format!(
            "<h3>To make it again</h3><p>With {FILE} (below), in a folder of its own, or here to replace it (--force). \
             <code>{}</code> derives calibration, measurement and figures again from the pictures and says what differs.</p>\
             <pre>{}</pre>",
            escape(session.command("verify SESSION --strict")),
            escape(lines)
        );
        out += &format!("<h3>Inputs of the material</h3>{}", files(ledger, material));
    }
    let mut evidence = String::new();
    if let Some(calibration) = calibration {
        evidence += &all("The calibration was made from", &calibration.inputs);
    }
    if session.path(INDEX).is_file() {
        evidence += &all("The measurement was made from", &measurement::made_from(ledger)?.inputs);
    }
    if session.path(SOURCES).is_file() {
        let sources: Vec<Input> = session.read_json(SOURCES, "diaphane import SESSION")?;
        evidence += &all("The measurement was imported from", &sources);
    }
    out += &evidence;
    let text = std::fs::read_to_string(session.path(FILE)).unwrap_or_default();
    let hash = ledger.file(FILE).blake3.unwrap_or_default();
    out += &format!(
        "<details><summary>{FILE}, BLAKE3 <code>{hash}</code></summary><pre>{}</pre></details>",
        escape(text.trim_end())
    );
    Ok(out + concat!("<p class=\"note\">Report by Diaphane ", env!("CARGO_PKG_VERSION"), ".</p>"))
}

/// What the material says of its making.
fn made(material: &Material) -> String {
    let made = material.provenance();
    let optics = material.optics();
    let captured = match made.captured_unix_s {
        0 => "unknown".into(),
        unix_s => utc(unix_s),
    };
    let mut rows = vec![
        ("Made by", format!("{} {}", escape(&made.software), escape(&made.version))),
        ("First picture", captured),
        (
            "Optics",
            format!(
                "η = {}, C = {:.4}, boundary {}, sides {}, light {}, scheme {}",
                optics.eta,
                optics.boundary_constant,
                word(&optics.boundary),
                word(&optics.lateral),
                word(&optics.illumination),
                word(&optics.scheme)
            ),
        ),
    ];
    if let Some(seed) = made.seed {
        rows.push(("Seed of the simulator", seed.to_string()));
    }
    for (name, value) in &made.settings {
        rows.push((name, escape(value)));
    }
    facts(&rows)
}

/// The material's inputs, and whether they are still there unchanged.
fn files(ledger: &Ledger<'_>, material: &Material) -> String {
    let mut rows = String::new();
    for input in &material.provenance().inputs {
        let now = match ledger.file(&input.name).blake3 {
            Some(hash) if hash == input.blake3 => "unchanged",
            // Only a part of it matters here; whether that is another one now is told at the top.
            Some(_) if input.name == FILE => "changed since",
            Some(_) => "<b>changed since: solve again</b>",
            None => "not there any more",
        };
        rows += &format!(
            "<tr><td>{}</td><td><code>{}</code></td><td>{now}</td></tr>",
            escape(&input.name),
            escape(&input.blake3)
        );
    }
    format!(
        "<div class=\"wide\"><table><thead><tr><th>file</th><th>BLAKE3</th><th>now</th></tr></thead>{rows}</table></div>"
    )
}

/// Inputs that are many, folded away.
fn all(what: &str, inputs: &[Input]) -> String {
    if inputs.is_empty() {
        return String::new();
    }
    let row = |i: &Input| {
        format!("<tr><td>{}</td><td><code>{}</code></td></tr>", escape(&i.name), escape(&i.blake3))
    };
    let rows: String = inputs.iter().map(row).collect();
    format!(
        "<details class=\"long\"><summary>{what} {}</summary><div class=\"wide\"><table><thead><tr><th>file</th><th>BLAKE3</th></tr>\
         </thead>{rows}</table></div></details>",
        counted(inputs.len(), "input")
    )
}

/// An enum's name as people write it.
fn word(value: &impl serde::Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => escape(name),
        Ok(other) => escape(other),
        Err(_) => String::new(),
    }
}
