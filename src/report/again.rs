//! The commands that make a material again.

use crate::commands::solve::Convergence;
use crate::sensor::NOISE;
use crate::session::{RigConfig, Session};
use crate::wheel::LIGHT;
use material::{Material, Provenance};

/// One command a line, from nothing but `session.toml` (and what was photographed).
pub(crate) fn commands(
    session: &Session,
    material: &Material,
    convergence: Option<&Convergence>,
) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    match session.config.rig {
        RigConfig::Imported => out.push("import SESSION --images DIR --manifest m.toml".into()),
        RigConfig::Simulated { .. } | RigConfig::Devices { .. } => {
            for (file, words) in [
                (NOISE, ["capture SESSION --noise", "calibrate noise SESSION"]),
                (LIGHT, ["capture SESSION --light", "calibrate light SESSION"]),
            ] {
                if session.path(file).is_file() {
                    out.extend(words.map(String::from));
                }
            }
            let words = ["calibrate all SESSION", "capture SESSION", "merge SESSION"];
            out.extend(words.map(String::from));
        }
    }
    out.push(format!("solve SESSION{}", solve_options(material.provenance(), convergence)));
    out.extend(["verify SESSION".to_owned(), "export SESSION".to_owned()]);
    out.iter().map(|words| session.command(words)).collect()
}

/// The options of the solve as they were given, each with a space before it.
fn solve_options(made: &Provenance, convergence: Option<&Convergence>) -> String {
    let setting = |name: &str| made.settings.get(name).map_or("", String::as_str);
    let mut out = String::new();
    if setting("method") == "Paper" {
        out += " --method paper";
    }
    if let Some(lambda) =
        setting("lambda").strip_prefix("Fixed(").and_then(|rest| rest.strip_suffix(')'))
    {
        out += &format!(" --lambda {lambda}");
    }
    if !["", "none"].contains(&setting("edge")) {
        out += " --edges";
    }
    if setting("free_gain") == "true" {
        out += " --free-gain";
    }
    let most = setting("max_evaluations");
    if !most.is_empty() {
        out += &format!(" --max-evaluations {most}");
    }
    match convergence.map(|c| c.device.as_str()) {
        None | Some("") => {}
        Some("CPU") => out += " --device cpu",
        Some(name) => out += &format!(" --device \"gpu:{name}\""),
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_those_that_were_given() {
        let made = |settings: &[(&str, &str)]| {
            let settings = settings.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned()));
            Provenance { settings: settings.collect(), ..Provenance::default() }
        };
        let convergence = |device: &str| Convergence {
            seconds: 1.0,
            fit: 0.0,
            device: device.into(),
            channels: Vec::new(),
            surface: Vec::new(),
        };
        let preset = [
            ("method", "Lbfgs"),
            ("lambda", "CrossValidation"),
            ("free_gain", "false"),
            ("edge", "none"),
        ];
        assert_eq!(solve_options(&made(&preset), Some(&convergence("CPU"))), " --device cpu");
        let given = [
            ("method", "Paper"),
            ("lambda", "Fixed(1e-5)"),
            ("free_gain", "true"),
            ("edge", "0.1"),
            ("max_evaluations", "12"),
        ];
        assert_eq!(
            solve_options(&made(&given), Some(&convergence("A B"))),
            " --method paper --lambda 1e-5 --edges --free-gain --max-evaluations 12 --device \"gpu:A B\""
        );
        assert_eq!(solve_options(&Provenance::default(), None), "");
    }
}
