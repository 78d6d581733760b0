//! What a material was made from, and whether that is still there unchanged.

use crate::Failure;
use crate::report::html::{escape, facts, utc};
use crate::session::Session;
use material::{Material, hash_file};

/// Everything that a material says about its making.
pub(crate) fn table(session: &Session, material: Option<&Material>) -> Result<String, Failure> {
    let Some(material) = material else {
        let path = session.path("session.toml");
        let hash = hash_file(&path)?;
        return Ok(facts(&[
            ("session.toml", format!("<code>{hash}</code>")),
            ("Report", concat!("Diaphane ", env!("CARGO_PKG_VERSION")).into()),
        ]));
    };
    let made = material.provenance();
    let optics = material.optics();
    let created = match made.created_unix_s {
        0 => "unknown".into(),
        unix_s => utc(unix_s),
    };
    let mut rows = vec![
        ("Made by", format!("{} {}", escape(&made.software), escape(&made.version))),
        ("Made on", created),
        (
            "Optics",
            format!(
                "η = {}, C = {:.4}, boundary {}, sides {}, light {}",
                optics.eta,
                optics.boundary_constant,
                word(&optics.boundary),
                word(&optics.lateral),
                word(&optics.illumination)
            ),
        ),
    ];
    if let Some(seed) = made.seed {
        rows.push(("Seed of the simulator", seed.to_string()));
    }
    for (name, value) in &made.settings {
        rows.push((name, escape(value)));
    }
    let mut out = facts(&rows);
    out += "<h3>Inputs</h3><div class=\"wide\"><table><thead><tr><th>file</th><th>BLAKE3</th><th>now</th></tr></thead>";
    for input in &made.inputs {
        let now = match hash_file(&session.path(&input.name)) {
            Ok(hash) if hash == input.blake3 => "unchanged".into(),
            // Only a part of it matters here; whether that is another one now is told at the top.
            Ok(_) if input.name == "session.toml" => "changed since".to_owned(),
            Ok(_) => "<b>changed since: solve again</b>".to_owned(),
            Err(_) => "not there any more".into(),
        };
        out += &format!(
            "<tr><td>{}</td><td><code>{}</code></td><td>{now}</td></tr>",
            escape(&input.name),
            escape(&input.blake3)
        );
    }
    Ok(out + "</table></div>")
}

/// An enum's name as people write it.
fn word(value: &impl serde::Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => escape(name),
        Ok(other) => escape(other),
        Err(_) => String::new(),
    }
}
