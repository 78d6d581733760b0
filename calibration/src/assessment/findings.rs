//! What a verdict rests on, figure by figure.
//!
//! The limits follow from what an error does to the product. A face fills half of the picture's
//! height, 40 mm say, and is lit region by region, a quarter of the face each; light falls off at
//! a region's edge over about 2 mm, a twentieth of the face or a fortieth of the picture's height
//! H. A pixel that looks δ aside reads a light that is wrong by δ/(H/40) there. Light under
//! patterns that were kept out of the fit is to agree within 2 % to be good and 10 % to be usable,
//! so δ is good up to H/2000 and usable up to H/400: 0.24 and 1.2 px in a picture of 480 rows.
//! The face lies in the middle of the picture, so it is the mean over the picture that is held
//! against these; its worst place, always at the rim, need only be usable.

use std::collections::HashMap;

use crate::assessment::coverage::{Coverage, Zone};
use crate::assessment::halves::HalfDifference;
use crate::assessment::verdict::{Grade, Reason, Verdict};
use crate::assessment::{Assessment, DeviceAssessment};
use crate::geometry::result::{Device, Geometry};
use crate::geometry::rig_view::Sight;

/// Corners of sharp pictures are found to 0.05 to 0.3 px, and Gray code is read to ±1/2 px, 0.4 px
/// RMS; three times as much is blur, motion, or a model that does not fit.
const RMS_PX: [f64; 2] = [0.5, 1.5];

/// 1-sigma of the focal length over itself. Distances along the line of sight scale with it, so
/// that a block 20 mm thick comes out wrong by 0.1 and 0.4 mm, a third of a cell and more than one.
const FOCAL_SHARE: [f64; 2] = [0.005, 0.02];

/// The same for the baseline, which scales the projector's distances.
const BASELINE_SHARE: [f64; 2] = [0.005, 0.02];

/// Boards that are all tilted by less say little about the focal length: the cosine of 20 degrees
/// is 0.94. In Zhang's simulation (2000, section 5.1) errors fall until about 45 degrees.
const LEAST_TILT: f64 = 20.0;

/// Fewer views cannot be cut into two halves that both make a calibration.
const FEWEST_VIEWS: usize = 6;

/// With so many each half has one to spare.
const WANTED_VIEWS: usize = 8;

/// A picture of which two thirds are empty is extrapolated, not calibrated.
const LEAST_COVERED: f64 = 1.0 / 3.0;

/// A view's RMS over the others' median: with 50 corners chance alone moves it by 7 %, and boards
/// near and far, steep and flat, by half as much again.
const ODD_VIEW: f64 = 2.5;

/// Share of points that may be off without a word.
const OUTLIERS: [f64; 2] = [0.01, 0.1];

/// Share of one view's points beyond which it is the view that is wrong and not the points.
const OUTLIERS_OF_VIEW: f64 = 0.2;

/// Half-and-half differences over the predicted ones. They hang on a few parameters: three times
/// the prediction happens once in 300 calibrations whose model is right.
const UNEXPECTED: f64 = 3.0;

/// Collects reasons and advice.
struct Judge<'a> {
    geometry: &'a Geometry,
    assessed: &'a Assessment,
    reasons: Vec<Reason>,
    advice: Vec<(Grade, String)>,
}

/// The verdict on a calibration.
pub(super) fn judge(geometry: &Geometry, assessed: &Assessment) -> Verdict {
    let mut judge = Judge { geometry, assessed, reasons: Vec::new(), advice: Vec::new() };
    judge.device("camera", &geometry.camera, &assessed.camera);
    if let (Some(projector), Some(found)) = (&geometry.projector, &assessed.projector) {
        judge.device("projector", &projector.device, found);
        let share = projector.baseline_standard_deviation_mm / projector.baseline_mm;
        let grade = Grade::of(share, BASELINE_SHARE);
        judge.tell(grade, format!("baseline known to ±{}", percent(share)));
        if grade != Grade::Good {
            judge.advise(grade, "take more views with the projector's light on the board");
        }
    }
    judge.tilts();
    judge.number();
    judge.views();
    judge.outliers();
    judge.missed();
    judge.done()
}

impl Judge<'_> {
    fn tell(&mut self, grade: Grade, text: impl Into<String>) {
        self.reasons.push(Reason { grade, text: text.into() });
    }

    fn advise(&mut self, grade: Grade, text: impl Into<String>) {
        let text = text.into();
        if !self.advice.iter().any(|(_, known)| *known == text) {
            self.advice.push((grade, text));
        }
    }

    fn done(mut self) -> Verdict {
        // Both sorts are stable: within a grade the order is the one of finding.
        self.reasons.sort_by_key(|r| std::cmp::Reverse(r.grade));
        self.advice.sort_by_key(|(grade, _)| std::cmp::Reverse(*grade));
        let grade = self.reasons.first().map_or(Grade::Redo, |r| r.grade);
        let advice = self.advice.into_iter().map(|(_, text)| text).collect();
        Verdict { grade, reasons: self.reasons, advice }
    }

    fn device(&mut self, name: &str, device: &Device, found: &DeviceAssessment) {
        let rows = device.model.height.min(device.model.width) as f64;
        let limits = [rows / 2000.0, rows / 400.0];
        self.rays(name, found, limits);
        self.coverage(name, &found.coverage);
        let focal = device.standard_deviations[0] / device.model.fx;
        let grade = Grade::of(focal, FOCAL_SHARE);
        self.tell(grade, format!("{name}: focal length known to ±{}", percent(focal)));
        if grade != Grade::Good {
            self.advise(grade, TILT_ADVICE);
        }
        let grade = Grade::of(device.rms_px, RMS_PX);
        self.tell(grade, format!("{name}: points are explained to {:.2} px RMS", device.rms_px));
        if grade != Grade::Good {
            self.advise(
                grade,
                if name == "camera" {
                    "corners fit badly throughout: check that focus and zoom are locked, the board \
                     is flat and still, its squares are counted and measured right, and the \
                     pictures are sharp"
                } else {
                    "projector pixels fit badly throughout: check that projector and camera did not \
                     move, that its keystone correction and scaling are off, and that the board lay \
                     still while the pattern was shown"
                },
            );
        }
        let halves = self.assessed.halves.as_ref();
        let halves =
            halves.and_then(|h| if name == "camera" { Some(h.camera) } else { h.projector });
        if let Some(halves) = halves {
            self.halves(name, halves, limits);
        }
    }

    fn rays(&mut self, name: &str, found: &DeviceAssessment, limits: [f64; 2]) {
        let sigma = &found.uncertainty;
        let rim = if sigma.worst_px <= limits[1] { Grade::Good } else { Grade::Usable };
        let grade = Grade::of(sigma.rms_px, limits).max(rim);
        let limit = match grade {
            Grade::Good => String::new(),
            Grade::Usable => format!("; good up to {:.2} and {:.2} px", limits[0], limits[1]),
            Grade::Redo => format!("; usable up to {:.2} px on average", limits[1]),
        };
        self.tell(
            grade,
            format!(
                "{name}: where a pixel looks is known to {:.2} px on average and {:.2} px at its \
                 worst, in the {}{limit}",
                sigma.rms_px,
                sigma.worst_px,
                sigma.worst_zone.name()
            ),
        );
        let views = self.geometry.views.len();
        // Empty zones, boards that were hardly tilted and few views say by themselves what to do.
        let gap = found.coverage.empty.contains(&sigma.worst_zone);
        if grade == Grade::Good || gap || self.flat() || views < FEWEST_VIEWS {
            return;
        }
        let excess = (sigma.rms_px / limits[0]).max(sigma.worst_px / limits[1]);
        let more = views as f64 * (excess.powi(2) - 1.0);
        if more <= 30.0 {
            let zone = sigma.worst_zone.name();
            let more = more.ceil();
            self.advise(
                grade,
                format!(
                    "{name}: take {more} more views, some with the board in the {zone}: uncertainty \
                     falls with the root of their number"
                ),
            );
        } else {
            self.advise(
                grade,
                format!(
                    "{name}: come closer or take a larger board, so that it fills a third of the \
                     picture, tilt it by 20–40° in all directions, and take a dozen views"
                ),
            );
        }
    }

    fn coverage(&mut self, name: &str, coverage: &Coverage) {
        let share = percent(coverage.share);
        if coverage.empty.is_empty() {
            self.tell(Grade::Good, format!("{name}: boards over {share} of the picture"));
            return;
        }
        let grade = if coverage.share >= LEAST_COVERED { Grade::Usable } else { Grade::Redo };
        let whose = if name == "camera" { "" } else { " of the projector's picture" };
        let views = if name == "camera" { "views" } else { "views with the light on the board" };
        let zones = list(&coverage.empty);
        self.tell(
            grade,
            format!("{name}: no board in the {zones}; {share} of the picture covered"),
        );
        self.advise(
            grade,
            match coverage.empty.len() {
                1 => format!("no board in the {zones}{whose}; add two {views} there"),
                2..=4 => format!("no board in the {zones}{whose}; add two {views} in each"),
                _ => format!(
                    "boards in a small part{whose} only: move the board into every corner and along \
                     every edge, two {views} each"
                ),
            },
        );
    }

    fn halves(&mut self, name: &str, halves: HalfDifference, limits: [f64; 2]) {
        // A half has twice the variance of the whole and the difference of two that twice again.
        let share = halves.rms_px / 2.0;
        let surprise = halves.rms_px > UNEXPECTED * halves.predicted_px;
        let grade = Grade::of(share, limits).max(if surprise && share > limits[0] / 4.0 {
            Grade::Usable
        } else {
            Grade::Good
        });
        self.tell(
            grade,
            format!(
                "{name}: odd and even views differ by {:.2} px RMS over the picture, {:.2} px \
                 predicted",
                halves.rms_px, halves.predicted_px
            ),
        );
        if grade != Grade::Good && surprise {
            self.advise(
                grade,
                format!(
                    "{name}: halves of the views differ by more than noise explains: something \
                     changed while the pictures were taken (focus, zoom, a bent board), or the \
                     distortion is too simple"
                ),
            );
        }
    }

    /// Whether the boards hardly differ in tilt.
    fn flat(&self) -> bool {
        self.assessed.stance.between_rad.to_degrees() < LEAST_TILT
    }

    fn tilts(&mut self) {
        let stance = self.assessed.stance;
        let [least, most] = stance.tilt_rad.map(f64::to_degrees);
        let between = stance.between_rad.to_degrees();
        let text = format!(
            "boards tilted by {least:.0}° to {most:.0}°, by up to {between:.0}° against each other"
        );
        if self.flat() {
            self.tell(Grade::Usable, format!("{text}: they say little about the focal length"));
            self.advise(Grade::Usable, TILT_ADVICE);
        } else {
            self.tell(Grade::Good, text);
        }
    }

    fn number(&mut self) {
        let views = self.geometry.views.len();
        if let Some(reason) = &self.assessed.without_halves {
            let text = format!("{views} views do not make two calibrations to compare ({reason})");
            self.tell(Grade::Usable, text);
        } else {
            self.tell(Grade::Good, format!("{views} views"));
        }
        if views < FEWEST_VIEWS {
            self.advise(
                Grade::Usable,
                format!(
                    "take at least {} more views: with {views} nothing checks the result",
                    WANTED_VIEWS - views
                ),
            );
        }
    }

    /// Views that fit much worse than the others.
    fn views(&mut self) {
        let views = &self.geometry.views;
        let mut all: Vec<f64> = views.iter().map(|v| v.camera_rms_px).collect();
        all.sort_unstable_by(f64::total_cmp);
        let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
        for (view, seen) in views.iter().zip(&self.geometry.observations) {
            let name = &view.name;
            let left_out = |o: &&crate::geometry::result::Outlier| {
                o.view == *name && o.sight == Sight::Printed
            };
            let lost = self.geometry.outliers.iter().filter(left_out).count();
            let points = seen.board.image_points.len();
            let times = view.camera_rms_px / median;
            if times > ODD_VIEW {
                self.tell(
                    Grade::Usable,
                    format!(
                        "view {name} fits {times:.1} times worse than the others ({:.2} px)",
                        view.camera_rms_px
                    ),
                );
            } else if lost as f64 > OUTLIERS_OF_VIEW * points as f64 {
                self.tell(
                    Grade::Usable,
                    format!("view {name}: {lost} of {points} corners do not go with the others"),
                );
            } else {
                continue;
            }
            self.advise(
                Grade::Usable,
                format!(
                    "view {name}: blurred, or board or camera moved? leave it out or take it again"
                ),
            );
        }
    }

    fn outliers(&mut self) {
        let points: usize = self.geometry.observations.iter().map(|v| v.sights()).sum();
        let lost = self.geometry.outliers.len();
        if lost == 0 {
            return;
        }
        let grade = Grade::of(lost as f64 / points.max(1) as f64, OUTLIERS);
        self.tell(grade, format!("{lost} of {points} points do not go with the others"));
        if grade == Grade::Good {
            return;
        }
        let advice = if self.same_corners() {
            "the same corners of the board are off in several views: is it bent or damaged there? \
             glue it onto glass"
        } else {
            "look at the points that were left out: reflections on the board, a hand before it, or \
             corners confused with something else"
        };
        self.advise(grade, advice);
    }

    /// Whether most printed corners that were left out were so in more than one view.
    fn same_corners(&self) -> bool {
        let printed = self.geometry.outliers.iter().filter(|o| o.sight == Sight::Printed);
        let mut views: HashMap<usize, usize> = HashMap::new();
        printed.for_each(|o| *views.entry(o.point).or_default() += 1);
        let all: usize = views.values().sum();
        let again: usize = views.values().filter(|n| **n > 1).sum();
        2 * again > all
    }

    fn missed(&mut self) {
        let missed = self.assessed.missed.len();
        if missed == 0 {
            return;
        }
        let all = missed + self.geometry.views.len();
        let grade = if 2 * missed > all { Grade::Usable } else { Grade::Good };
        self.tell(grade, format!("{missed} of {all} pictures without a board"));
        self.advise(
            grade,
            format!("take the {missed} pictures without a board again, or delete them"),
        );
    }
}

const TILT_ADVICE: &str = "tilt the board by 20–40°, in another direction in each view";

/// "upper edge, left edge and middle".
fn list(zones: &[Zone]) -> String {
    let names: Vec<&str> = zones.iter().map(|z| z.name()).collect();
    match names.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => names.concat(),
    }
}

/// Two digits of a share.
fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    let decimals = if percent >= 9.95 {
        0
    } else if percent >= 0.995 {
        1
    } else {
        2
    };
    format!("{percent:.decimals$} %")
}
