//! How good a material is, in words.

use crate::commands::verify::Verification;
use calibration::Grade;
use serde::Serialize;

/// One figure that the grade rests on.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Figure {
    pub name: &'static str,
    pub meaning: &'static str,
    pub value: f64,
    /// Good up to here.
    pub good: f64,
    /// Usable up to here.
    pub usable: f64,
    /// Written as a percentage.
    pub percent: bool,
    pub grade: Grade,
}

impl Figure {
    fn new(
        name: &'static str,
        meaning: &'static str,
        value: f64,
        [good, usable]: [f64; 2],
        percent: bool,
    ) -> Self {
        let grade = Grade::of(value, [good, usable]);
        Self { name, meaning, value, good, usable, percent, grade }
    }

    /// A value of this figure as people write it.
    pub fn show(&self, value: f64) -> String {
        if self.percent { format!("{:.2} %", 100.0 * value) } else { format!("{value:.1e}") }
    }
}

/// The worst of its figures.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Verdict {
    pub grade: Grade,
    pub figures: Vec<Figure>,
}

impl Verdict {
    /// What the grade means, in a sentence.
    pub fn sentence(&self) -> &'static str {
        match self.grade {
            Grade::Good => {
                "The material looks like the sample, also under light it was not fitted to."
            }
            Grade::Usable => {
                "The material has the look of the sample; fine detail or absolute values are off."
            }
            Grade::Redo => "The material does not look like the sample: measure or solve again.",
        }
    }

    /// An eye tells 2 % of contrast apart in a smooth picture: held-out light within that is
    /// good, and the fit, a square, within 2e-4 (1.4 % relative RMS). Usable ends at 10 %
    /// relative RMS, where the difference shows side by side. E weighs squares over all of the
    /// surface: 5e-3 is 7 %, 5e-2 is 22 % relative RMS of the diffuse BSSRDF.
    pub fn of(checked: &Verification) -> Self {
        let mut figures = Vec::new();
        if let Some(e) = checked.heldout_rel_rms {
            let meaning = "relative RMS difference under patterns that were kept out of the fit";
            figures.push(Figure::new("held-out error", meaning, e, [0.02, 0.10], true));
        }
        let meaning = "Σ(L − L′)² / ΣL² over the fitted patterns";
        figures.push(Figure::new("fit", meaning, checked.fit, [2e-4, 1e-2], false));
        if let Some(e) = checked.bssrdf_error {
            let meaning =
                "Σ(R − R′)² / ΣR² against the true diffuse BSSRDF, which the simulator knows";
            figures.push(Figure::new("BSSRDF error E", meaning, e, [5e-3, 5e-2], false));
        }
        let grade = figures.iter().map(|f| f.grade).max().unwrap_or(Grade::Redo);
        Self { grade, figures }
    }

    /// Why it is not better, or that nothing stands against it.
    pub fn reason(&self) -> String {
        let worst: Vec<String> = self
            .figures
            .iter()
            .filter(|f| f.grade == self.grade && f.grade != Grade::Good)
            .map(|f| {
                let limit = if f.grade == Grade::Redo { f.usable } else { f.good };
                format!("{} is {}, above {}", f.name, f.show(f.value), f.show(limit))
            })
            .collect();
        if worst.is_empty() { "every figure is within its limit".into() } else { worst.join("; ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(fit: f64, held: Option<f64>, e: Option<f64>) -> Verification {
        Verification {
            fit,
            heldout_rel_rms: held,
            bssrdf_error: e,
            bssrdf_error_by_channel: Vec::new(),
            lit_pixels: None,
            patterns: Vec::new(),
            inputs: Vec::new(),
        }
    }

    #[test]
    fn the_worst_figure_decides() {
        let grade = |fit, held, e| Verdict::of(&checked(fit, held, e)).grade;
        assert_eq!(grade(1e-4, Some(0.01), Some(4e-3)), Grade::Good);
        assert_eq!(grade(1e-4, None, None), Grade::Good);
        assert_eq!(grade(1e-4, Some(0.03), Some(4e-3)), Grade::Usable);
        assert_eq!(grade(1e-4, Some(0.01), Some(0.2)), Grade::Redo);
        assert_eq!(grade(f64::NAN, Some(0.01), None), Grade::Redo);
    }

    #[test]
    fn the_reason_names_figure_and_limit() {
        let verdict = Verdict::of(&checked(1e-4, Some(0.03), None));
        assert_eq!(verdict.reason(), "held-out error is 3.00 %, above 2.00 %");
    }
}
