//! How each exposure of each shot came out: how bright, how much of it clipped.

use crate::output::counted;
use crate::report::html::escape;
use crate::session::Session;
use rig::{BLACK_SHOT, Event, FrameStats, Plan, Recorded, read_frame};
use std::collections::BTreeMap;

/// Share of clipped values above which it is told: more than hot pixels and a glint.
const CLIPPED: f64 = 1e-3;
/// Mean light, a share of full scale, below which a picture is nearly black: a third of a step of 8 bits.
const DIM: f64 = 1e-3;

/// The last frame of each shot and exposure.
type Frames<'a> = BTreeMap<(&'a str, usize), Vec<(f64, &'a FrameStats)>>;

/// A table of the sample's shots over their exposures, and a word on all other pictures; nothing
/// where no frame was taken.
pub(crate) fn exposures(session: &Session, journal: &Recorded, sample: &Plan) -> Option<String> {
    let frames = frames(journal);
    if frames.is_empty() {
        return None;
    }
    let full_scale = full_scale(session, journal);
    let shots: Vec<&str> = sample.shots.iter().map(|s| s.name.as_str()).collect();
    let (of_sample, others): (Frames<'_>, Frames<'_>) =
        frames.into_iter().partition(|((shot, _), _)| shots.contains(shot));
    let mut out = String::new();
    if !of_sample.is_empty() {
        out += &format!(
            "<p>Mean light of each picture, that of the black one taken off, in percent of what the camera can give. \
             <b class=\"clipped\">Red</b>: so much of it is clipped beyond what is in the black picture too; a bracket should \
             begin without. <span class=\"dim\">Grey</span>: nearly black; a bracket should not end so. \
             The merge uses of each pixel what is neither.</p>{}",
            table(&shots, &of_sample, full_scale)
        );
    }
    if !others.is_empty() {
        let all: Vec<&FrameStats> = others.values().flatten().map(|(_, s)| *s).collect();
        let clipped: Vec<&str> = others
            .iter()
            .filter(|(_, all)| all.iter().any(|(_, s)| s.clipped_share > CLIPPED))
            .map(|((shot, _), _)| *shot)
            .collect();
        let mut names = clipped.clone();
        names.dedup();
        let which = match names.len() {
            0 => String::new(),
            1..=12 => format!(": {}", escape(names.join(", "))),
            n => format!(", of {n} shots"),
        };
        out += &format!(
            "<p>Beside these, {} of boards, chart, sheet and other things; clipped by more than {:.1} % in {}{which}. \
             Brackets of chart and sheet are long on purpose.</p>",
            counted(all.len(), "picture"),
            100.0 * CLIPPED,
            clipped.len()
        );
    }
    Some(out)
}

/// One line a shot, one column an exposure time.
fn table(shots: &[&str], frames: &Frames<'_>, full_scale: Option<f64>) -> String {
    // Exposure times to a microsecond, so that those of all shots share columns.
    let column = |seconds: f64| (1e6 * seconds).round() as u64;
    let mut cells: BTreeMap<(&str, u64), Vec<&FrameStats>> = BTreeMap::new();
    for ((shot, _), all) in frames {
        for (seconds, stats) in all {
            cells.entry((shot, column(*seconds))).or_default().push(stats);
        }
    }
    let mut times: Vec<u64> = cells.keys().map(|(_, time)| *time).collect();
    times.sort_unstable();
    times.dedup();
    let head: String =
        times.iter().map(|t| format!("<th>{}</th>", told_time(*t as f64 / 1e6))).collect();
    // The means of repeats, and the worst of their clipping.
    let level = |shot: &str, time: u64| {
        let all = cells.get(&(shot, time))?;
        let mean = all.iter().map(|s| s.mean).sum::<f64>() / all.len() as f64;
        Some((mean, all.iter().map(|s| s.clipped_share).fold(0.0, f64::max)))
    };
    let cell = |shot: &str, time: u64| {
        let Some((mean, clipped)) = level(shot, time) else { return "<td></td>".to_owned() };
        // A white tile beside the block is lit, and may clip, in the black picture as well.
        let black = if shot == BLACK_SHOT { None } else { level(BLACK_SHOT, time) };
        let (dark, tile) = black.unwrap_or((0.0, 0.0));
        let light = (mean - dark).max(0.0);
        let share = full_scale.map(|full| light / full);
        let told =
            share.map_or(format!("{light:.0} DN"), |share| format!("{:.1} %", 100.0 * share));
        let dim = share.is_some_and(|share| share < DIM);
        let class = if dim { " class=\"dim\"" } else { "" };
        let clipped = clipped - tile;
        let over = if clipped > CLIPPED {
            format!("<br><b class=\"clipped\">clipped {:.1} %</b>", 100.0 * clipped)
        } else {
            String::new()
        };
        format!("<td{class}>{told}{over}</td>")
    };
    let rows: String = shots
        .iter()
        .filter(|shot| cells.keys().any(|(name, _)| name == *shot))
        .map(|shot| {
            let row: String = times.iter().map(|t| cell(shot, *t)).collect();
            format!("<tr><th>{}</th>{row}</tr>", escape(shot))
        })
        .collect();
    format!(
        "<div class=\"wide\"><table class=\"exposures\"><thead><tr><th></th>{head}</tr></thead>{rows}</table></div>"
    )
}

fn told_time(seconds: f64) -> String {
    if seconds < 0.1 { format!("{:.0} ms", 1e3 * seconds) } else { format!("{seconds:.2} s") }
}

/// Frames that were taken again replace what they were before; repeats stand beside each other.
fn frames(journal: &Recorded) -> Frames<'_> {
    let mut last: BTreeMap<&str, (&str, usize, f64, &FrameStats)> = BTreeMap::new();
    for entry in &journal.entries {
        if let Event::FrameWritten {
            shot,
            exposure_index,
            file,
            requested_s,
            exposure_s,
            stats,
            ..
        } = &entry.event
        {
            let seconds = requested_s.unwrap_or(*exposure_s);
            last.insert(file, (shot, *exposure_index, seconds, stats));
        }
    }
    let mut out = Frames::new();
    for (shot, index, seconds, stats) in last.into_values() {
        out.entry((shot, index)).or_default().push((seconds, stats));
    }
    out
}

/// Largest number that the camera gives, by the first frame that can be read.
fn full_scale(session: &Session, journal: &Recorded) -> Option<f64> {
    let hashes = journal.frame_hashes();
    let file = hashes.keys().find(|file| session.path(file).is_file())?;
    let (frame, _) = read_frame(&session.path(file)).ok()?;
    Some(f64::from(frame.max_value()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stats(mean: f64, clipped_share: f64) -> FrameStats {
        FrameStats { min: 0, max: 1000, mean, clipped_share, focus: 0.0, patch: None }
    }

    /// Against a black picture of 10 of 1000 with a tile of 5 % that clips.
    #[test]
    fn cells_tell_light_and_clipping() {
        let [black, dark, fair, over] =
            [(10.0, 0.05), (10.5, 0.05), (510.0, 0.05), (1000.0, 0.3)].map(|(m, c)| stats(m, c));
        let frames = Frames::from([
            ((BLACK_SHOT, 0), vec![(0.05, &black)]),
            ((BLACK_SHOT, 1), vec![(2.0, &black)]),
            (("a", 0), vec![(0.05, &dark)]),
            (("a", 1), vec![(2.0, &fair)]),
            (("b", 0), vec![(2.0, &over)]),
        ]);
        let table = table(&[BLACK_SHOT, "a", "b", "not-taken"], &frames, Some(1000.0));
        for cell in [
            "<th>50 ms</th><th>2.00 s</th>",
            "<th>black</th><td>1.0 %<br><b class=\"clipped\">clipped 5.0 %</b></td>",
            "<th>a</th><td class=\"dim\">0.1 %</td><td>50.0 %</td>",
            "<th>b</th><td></td><td>99.0 %<br><b class=\"clipped\">clipped 25.0 %</b></td>",
        ] {
            assert!(table.contains(cell), "{cell} in {table}");
        }
        assert!(!table.contains("not-taken"));
    }
}
