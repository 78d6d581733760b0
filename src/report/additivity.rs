//! Light adds up: a check of the pictures that needs no material.
//!
//! Where a held-out pattern is a sum of fitted ones, its picture must be the same sum of theirs.
//! What is off here is off before the solve: in the response, the black level or the light.

use crate::measurement::{Measured, MeasuredPattern};
use crate::report::html::escape;
use rig::Purpose;

/// A pattern counts as a sum of others where the sum leaves this share of its light.
const SAME_LIGHT: f64 = 0.01;

/// One held-out pattern against the sum of fitted ones.
struct Sum<'a> {
    name: &'a str,
    /// Σ of the sum's picture over Σ of the pattern's own, each channel.
    ratio: Vec<f64>,
    /// Relative RMS over all channels.
    rel_rms: f64,
}

/// A table of all patterns that are sums of fitted ones; nothing where there are none.
pub(crate) fn table(measured: &Measured) -> Option<String> {
    let fitted = measured.select(Purpose::Fit);
    let sums: Vec<Sum<'_>> =
        measured.select(Purpose::HeldOut).into_iter().filter_map(|p| compare(p, &fitted)).collect();
    if sums.is_empty() {
        return None;
    }
    let names: String =
        measured.channels.iter().map(|c| format!("<th>{}</th>", escape(c))).collect();
    let row = |s: &Sum<'_>| {
        let ratios: String = s.ratio.iter().map(|r| format!("<td>{r:.3}</td>")).collect();
        format!("<tr><td>{}</td>{ratios}<td>{:.2} %</td></tr>", escape(s.name), 100.0 * s.rel_rms)
    };
    let rows: String = sums.iter().map(row).collect();
    Some(format!(
        "<p>These patterns are sums of fitted ones, so their pictures must be the same \
         sums, whatever the material is: 1 in each channel. What is off here is off before the solve: look at exposures, \
         black level and calibration.</p><div class=\"wide\"><table><thead><tr><th>pattern</th>{names}\
         <th>relative RMS</th></tr></thead>{rows}</table></div>"
    ))
}

fn compare<'a>(pattern: &'a MeasuredPattern, fitted: &[&MeasuredPattern]) -> Option<Sum<'a>> {
    let weights = weights(pattern, fitted)?;
    let used: Vec<(f64, &&MeasuredPattern)> =
        weights.into_iter().zip(fitted).filter(|(w, _)| w.abs() > 1e-3).collect();
    let (mut ratio, mut error, mut energy) = (Vec::new(), 0.0, 0.0);
    for (c, (radiance, variance)) in pattern.radiance.iter().zip(&pattern.variance).enumerate() {
        let (mut own, mut sum) = (0.0, 0.0);
        for (i, (l, v)) in radiance.iter().zip(variance).enumerate() {
            if v.is_finite() && used.iter().all(|(_, p)| p.variance[c][i].is_finite()) {
                let s: f64 = used.iter().map(|(w, p)| w * p.radiance[c][i]).sum();
                own += l;
                sum += s;
                error += (s - l) * (s - l);
                energy += l * l;
            }
        }
        ratio.push(sum / own);
    }
    (energy > 0.0 && ratio.iter().all(|r| r.is_finite())).then(|| Sum {
        name: &pattern.name,
        ratio,
        rel_rms: (error / energy).sqrt(),
    })
}

/// Weights of the fitted patterns whose sum has the light of `pattern`: conjugate gradients on
/// the normal equations. None where no sum has.
fn weights(pattern: &MeasuredPattern, fitted: &[&MeasuredPattern]) -> Option<Vec<f64>> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let project = |r: &[f64]| fitted.iter().map(|p| dot(&p.irradiance, r)).collect::<Vec<_>>();
    let mut w = vec![0.0; fitted.len()];
    let mut r = pattern.irradiance.clone();
    let all = dot(&r, &r);
    let mut s = project(&r);
    let mut direction = s.clone();
    let mut slope = dot(&s, &s);
    for _ in 0..2 * fitted.len() {
        if dot(&r, &r) <= SAME_LIGHT * SAME_LIGHT * all || slope <= 0.0 {
            break;
        }
        let mut q = vec![0.0; r.len()];
        for (p, d) in fitted.iter().zip(&direction) {
            q.iter_mut().zip(&p.irradiance).for_each(|(q, e)| *q += d * e);
        }
        let step = slope / dot(&q, &q);
        if !step.is_finite() {
            break;
        }
        w.iter_mut().zip(&direction).for_each(|(w, d)| *w += step * d);
        r.iter_mut().zip(&q).for_each(|(r, q)| *r -= step * q);
        s = project(&r);
        let next = dot(&s, &s);
        direction.iter_mut().zip(&s).for_each(|(d, s)| *d = s + next / slope * *d);
        slope = next;
    }
    (all > 0.0 && dot(&r, &r) <= SAME_LIGHT * SAME_LIGHT * all).then_some(w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::Face;

    fn pattern(name: &str, held_out: bool, irradiance: &[f64], scale: f64) -> MeasuredPattern {
        let radiance = irradiance.iter().map(|e| scale * (0.1 + e)).collect();
        let purpose = if held_out { Purpose::HeldOut } else { Purpose::Fit };
        let variance = vec![vec![1.0; irradiance.len()]];
        let place = (Face::Back, [irradiance.len(), 1]);
        let irradiance = irradiance.to_vec();
        MeasuredPattern::new((name.into(), purpose), place, irradiance, vec![radiance], variance)
    }

    #[test]
    fn a_sum_is_found_and_compared() {
        let patterns = [
            pattern("left", false, &[1.0, 1.0, 0.0, 0.0], 1.0),
            pattern("right", false, &[0.0, 0.0, 2.0, 1.0], 1.0),
            // Its own picture is half of 0.2 + irradiance, what the two together have.
            pattern("both", true, &[1.0, 1.0, 2.0, 1.0], 0.5),
            pattern("other", true, &[1.0, 0.0, 1.0, 0.0], 1.0),
        ];
        let held: Vec<_> = patterns.iter().filter(|p| p.held_out()).collect();
        let fitted: Vec<_> = patterns.iter().filter(|p| !p.held_out()).collect();
        let found = compare(held[0], &fitted).unwrap();
        // Sums of four cells: 5 + 4 · 0.2 against half of 5 + 4 · 0.1; rounding only.
        assert!((found.ratio[0] - 5.8 / 2.7).abs() < 1e-12, "{}", found.ratio[0]);
        assert!(compare(held[1], &fitted).is_none());
    }
}
