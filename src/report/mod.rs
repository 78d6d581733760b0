//! A session on one page: how good the material is and why, what it looks like, where it comes
//! from. One HTML file that needs nothing else.

mod additivity;
mod again;
mod bar;
mod calibration;
mod chart;
pub(crate) mod colour;
mod convergence;
mod depths;
mod exposures;
pub(crate) mod html;
mod images;
pub(crate) mod picture;
mod provenance;
mod resolution;
mod scanline;
mod surface;
mod timeline;
mod verdict;
mod volumes;

pub(crate) use calibration::calibration_page;
pub(crate) use verdict::Verdict;

use crate::Failure;
use crate::adaptive;
use crate::commands::calibrate::{self, Calibrated};
use crate::commands::solve::{CONVERGENCE, Convergence, MATERIAL};
use crate::commands::verify::{RESULT, Verification};
use crate::measurement::{ARRAYS, Measured};
use crate::output::counted;
use crate::session::Session;
use crate::steps::{Ledger, State, Step, rests_on};
use html::{capital, escape, section};
use material::{Face, Material};
use rig::Purpose;

/// What a session holds so far.
struct Found {
    measured: Option<Measured>,
    material: Option<Material>,
    convergence: Option<Convergence>,
    verification: Option<Verification>,
    calibration: Option<Calibrated>,
}

impl Found {
    fn look(session: &Session) -> Result<Self, Failure> {
        let there = |path: &str| session.path(path).is_file();
        let measured = there(ARRAYS).then(|| Measured::load(session)).transpose()?;
        let path = session.path(MATERIAL);
        let material = path.is_file().then(|| Material::load(&path)).transpose()?;
        let convergence = there(CONVERGENCE)
            .then(|| session.read_json(CONVERGENCE, "diaphane solve SESSION"))
            .transpose()?;
        let verification = there(RESULT)
            .then(|| session.read_json(RESULT, "diaphane verify SESSION"))
            .transpose()?;
        let calibration =
            calibrate::is_done(session).then(|| calibrate::load(session)).transpose()?;
        Ok(Self { measured, material, convergence, verification, calibration })
    }
}

/// The page, and the verdict on it where there is one; `steps` are those of the ledger's session.
pub(crate) fn page(
    ledger: &Ledger<'_>,
    steps: &[Step],
) -> Result<(String, Option<Verdict>), Failure> {
    let session = ledger.session;
    let shown = |s: &&Step| s.state == State::Damaged && rests_on("report").contains(&s.name);
    if let Some(damaged) = steps.iter().find(shown) {
        let error = format!("{}: {}", damaged.name, damaged.told());
        return Err(Failure::input(error).hint(format!("make it again: {}", damaged.command)));
    }
    let mut found = Found::look(session)?;
    if steps.iter().any(|s| s.result == Some(RESULT) && s.state == State::OutOfDate) {
        // Figures of something else than the rest of the page shows.
        found.verification = None;
    }
    let verdict = found.verification.as_ref().map(Verdict::of);
    let mut body = head(session, &found);
    body += &out_of_date(steps);
    body += &match &verdict {
        Some(verdict) => judged(verdict),
        None => unjudged(steps),
    };
    let warnings = found.material.as_ref().map_or(Vec::new(), crate::regime::warnings);
    if !warnings.is_empty() {
        body += &section("Where the model ends", &doubted(&warnings));
    }
    if let (Some(measured), Some(material)) = (&found.measured, &found.material) {
        let shown = images::compared(measured, material, found.verification.as_ref())?;
        body += &section("Captured and relit", &shown);
    } else if let Some(measured) = &found.measured {
        body += &section("Captured", &images::captured(measured, &session.config.sample.grid)?);
    }
    if let Some(table) = found.measured.as_ref().and_then(additivity::table) {
        body += &section("Does the light add up?", &table);
    }
    if let Some(material) = &found.material {
        let inside = volumes::volumes(material)? + &resolution::resolution(material)?;
        body += &section("Inside the material", &inside);
        if let Some(shown) =
            surface::surface(material, found.convergence.as_ref(), found.verification.as_ref())?
        {
            body += &section("On the surface", &shown);
        }
    }
    if let Some(convergence) = &found.convergence {
        body += &section("How the solve went", &convergence::converged(convergence));
    }
    if let Some(calibration) = &found.calibration {
        body += &section("Calibration", &calibration::summary(calibration)?);
    }
    let journal = &ledger.journal;
    if let Some(table) = exposures::exposures(session, journal, &adaptive::sample_plan(session)?) {
        body += &section("Exposures", &table);
    }
    if let Some(told) = timeline::timeline(journal) {
        body += &section("The capture", &told);
    }
    let origin = provenance::provenance(
        ledger,
        found.material.as_ref(),
        found.convergence.as_ref(),
        found.calibration.as_ref(),
    )?;
    body += &section("Where it comes from", &origin);
    Ok((html::page(&session.config.sample.name, calibration::STYLE, &body), verdict))
}

fn head(session: &Session, found: &Found) -> String {
    let sample = &session.config.sample;
    let [w, h, d] = sample.grid.size_mm();
    let [nx, ny, nz] = sample.grid.cells();
    let face = match sample.lit_face {
        Face::Front => "front",
        Face::Back => "back",
    };
    let patterns = found.measured.as_ref().map_or(String::new(), |m| {
        let held = m.select(Purpose::HeldOut).len();
        let surface = match m.select(Purpose::Surface).len() {
            0 => String::new(),
            n => format!(", {n} for the surface alone"),
        };
        format!(
            " Measured under {}, {held} of them kept out of the fit{surface}.",
            counted(m.patterns.len(), "pattern")
        )
    });
    format!(
        "<header><h1>{}</h1><p class=\"soft\">{w:.1} × {h:.1} × {d:.1} mm on {nx} × {ny} × {nz} cells, \
         lit on the {face} face, η = {}.{patterns}</p></header>\n",
        escape(&sample.name),
        sample.eta
    )
}

fn judged(verdict: &Verdict) -> String {
    let row = |f: &verdict::Figure| {
        format!(
            "<tr><td>{}</td><td class=\"{4}\">{}</td><td>≤ {}</td><td>≤ {}</td><td class=\"{4}\">{4}</td></tr>\
             <tr class=\"meaning\"><td colspan=\"5\">{5}</td></tr>",
            escape(f.name),
            f.show(f.value),
            f.show(f.good),
            f.show(f.usable),
            f.grade.word(),
            escape(f.meaning),
        )
    };
    let rows: String = verdict.figures.iter().map(row).collect();
    format!(
        "<div class=\"verdict {0}\"><strong>{0}</strong><p>{1} {2}.</p><div class=\"wide\"><table><thead><tr>\
         <th>figure</th><th>value</th><th>good</th><th>usable</th><th></th></tr></thead>{rows}</table></div></div>\n",
        verdict.grade.word(),
        verdict.sentence(),
        escape(capital(&verdict.reason())),
    )
}

fn doubted(warnings: &[String]) -> String {
    let lines: String = warnings.iter().map(|w| format!("<li>{}</li>", escape(w))).collect();
    format!(
        "<p>κ and μ are found by the diffusion equation, which approximates how light really scatters. Against \
         Monte Carlo, with the true κ and μ:</p><ul>{lines}</ul><p>What is fitted makes up for a part of it: pictures \
         can agree while κ and μ are a little off.</p>"
    )
}

/// What on this page does not go together with the rest of it.
fn out_of_date(steps: &[Step]) -> String {
    let stale = steps.iter().filter(|s| s.name != "report" && s.state == State::OutOfDate);
    let row = |s: &Step| {
        let left_out = if s.result == Some(RESULT) { " It is left out here." } else { "" };
        format!(
            "<tr><th>{}</th><td>{}.{left_out} <code>{}</code></td></tr>",
            escape(s.name),
            escape(s.told()),
            escape(&s.command)
        )
    };
    let rows: String = stale.map(row).collect();
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<div class=\"verdict unfinished\"><strong>out of date</strong><p>Parts of this session were made from \
         something else than is there now, and say nothing about the rest. What they are, and the command that makes \
         them anew:</p><table class=\"facts\">{rows}</table></div>\n"
    )
}

fn unjudged(steps: &[Step]) -> String {
    let row = |s: &Step| {
        let told = match s.state {
            State::Done => escape(s.told()),
            State::Missing => format!("<code>{}</code>", escape(&s.command)),
            State::OutOfDate | State::Damaged => {
                format!("{} <code>{}</code>", escape(s.told()), escape(&s.command))
            }
        };
        let frames = s.frames.as_ref().map_or(String::new(), |f| {
            let wanted = counted(f.wanted, "picture");
            format!(" <span class=\"soft\">{} of {wanted}</span>", f.taken)
        });
        format!("<tr><th>{}</th><td>{told}{frames}</td></tr>", escape(s.name))
    };
    // The report cannot miss itself.
    let rows: String = steps.iter().filter(|s| s.name != "report").map(row).collect();
    format!(
        "<div class=\"verdict unfinished\"><strong>not finished</strong><p>There is no verdict yet. \
         What is missing, and the command that makes it:</p><table class=\"facts\">{rows}</table></div>\n"
    )
}
