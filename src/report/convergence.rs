//! How the solve went, channel by channel.

use crate::commands::solve::Convergence;
use crate::report::chart::{Line, logarithmic};
use crate::report::html::escape;

/// The fit over the gradient evaluations, and a table of what it ended with.
pub(crate) fn converged(convergence: &Convergence) -> String {
    let classes = ["r", "g", "b"];
    let lines: Vec<Line<'_>> = convergence
        .channels
        .iter()
        .enumerate()
        .map(|(i, c)| Line { name: &c.channel, class: classes[i % 3], values: &c.history })
        .collect();
    let chart = logarithmic(&lines, "gradient evaluations", "fit").unwrap_or_default();
    let rows: String = convergence
        .channels
        .iter()
        .map(|c| {
            format!(
                "<tr><td>{}</td><td>{:.2e}</td><td>{:.2}</td><td>{:.1e}</td><td>{:.3}</td><td>{}</td><td>{}</td><td>{:.3} mm</td><td>{:.4} /mm</td></tr>",
                escape(&c.channel),
                c.fit,
                c.chi2,
                c.lambda,
                c.gain,
                c.gradient_evaluations,
                c.linear_solves,
                c.homogeneous_kappa_mm,
                c.homogeneous_mu_per_mm
            )
        })
        .collect();
    let cut_off = convergence.cut_off().map_or(String::new(), |cut_off| {
        format!(
            "<p><b>The solve {}.</b> κ and μ are not yet what the pictures say.</p>",
            escape(cut_off)
        )
    });
    format!(
        "{cut_off}<p>Fit, Σ(L − L′)² / ΣL², after each gradient evaluation. {:.0} s in all. χ²/N near 1 means that what is \
         left is noise, far below 1 that what the model is allowed to get wrong outweighs the noise; a gain near 1 means that the radiometry is right.</p>{chart}\
         <div class=\"wide\"><table><thead><tr><th>channel</th><th>fit</th><th>χ²/N</th><th>λ</th><th>gain</th>\
         <th>gradients</th><th>solves</th><th>start κ</th><th>start μ</th></tr></thead>{rows}</table></div>",
        convergence.seconds
    )
}
