//! The capture over time: runs, pictures, warnings.

use crate::output::{counted, duration};
use crate::report::chart::round_step;
use crate::report::html::{escape, utc};
use rig::{Entry, Event, Recorded, StopStatus};
use std::fmt::Write as _;

/// A pause of this many seconds or more is cut out of the plot.
const PAUSE_S: f64 = 600.0;
/// What a pause that was cut out takes, as a share of the time that is shown.
const CUT: f64 = 0.02;
/// Most lines of words; the page stays light.
const MOST: usize = 60;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 220.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 44.0;

/// What happened, in a plot, a table of runs, and words; nothing for a journal without entries.
pub(crate) fn timeline(journal: &Recorded) -> Option<String> {
    let (first, last) = (journal.entries.first()?, journal.entries.last()?);
    let frames = of_frames(journal).count();
    let warnings = journal.entries.iter().filter(|e| matches!(e.event, Event::Warned { .. }));
    let warned = match warnings.count() {
        0 => "no warning".to_owned(),
        n => counted(n, "warning"),
    };
    let mut out = format!(
        "<p>{} and {warned} from {} to {}. Pictures so far over the time at work; pauses of more than {:.0} minutes \
         are cut out (dashed), circles are warnings.</p>",
        counted(frames, "picture"),
        utc(first.unix_s.max(0.0) as u64),
        utc(last.unix_s.max(0.0) as u64),
        PAUSE_S / 60.0
    );
    out += &plot(journal);
    out += &runs(journal);
    out += &words(journal);
    if journal.torn_bytes > 0 {
        out += "<p>The journal's last line was cut off while it was written.</p>";
    }
    Some(out)
}

fn of_frames(journal: &Recorded) -> impl Iterator<Item = &Entry> {
    journal.entries.iter().filter(|e| matches!(e.event, Event::FrameWritten { .. }))
}

/// Seconds at work of each entry, and where pauses were cut out: a clock that was set back stands
/// still.
fn at_work(journal: &Recorded) -> (Vec<f64>, Vec<f64>) {
    let steps: Vec<f64> = journal
        .entries
        .windows(2)
        .map(|pair| (pair[1].unix_s - pair[0].unix_s).max(0.0))
        .map(|step| if step.is_finite() { step } else { 0.0 })
        .collect();
    let worked: f64 = steps.iter().filter(|s| **s < PAUSE_S).sum();
    let cut = CUT * worked.max(1.0);
    let (mut now, mut times, mut cuts) = (0.0, vec![0.0], Vec::new());
    for step in steps {
        if step < PAUSE_S {
            now += step;
        } else {
            cuts.push(now + cut / 2.0);
            now += cut;
        }
        times.push(now);
    }
    (times, cuts)
}

fn plot(journal: &Recorded) -> String {
    let (times, cuts) = at_work(journal);
    let all = of_frames(journal).count().max(1) as f64;
    let whole = times.last().copied().unwrap_or(0.0).max(1.0);
    let x = |s: f64| LEFT + (WIDTH - LEFT - RIGHT) * s / whole;
    let y = |n: f64| TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - n / all);
    let mut out = format!(
        "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"pictures over time\">"
    );
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    let step = round_step(all / 4.0).max(1.0);
    for k in 0..=4 {
        let n = f64::from(k) * step;
        if n <= all {
            let at = y(n);
            let _ = write!(
                out,
                "<line class=\"rule\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{n:.0}</text>",
                LEFT - 6.0,
                at + 4.5
            );
        }
    }
    let (unit, length) = if whole < 180.0 { ("s", 1.0) } else { ("min", 60.0) };
    let step = round_step(whole / length / 6.0);
    for k in 0..=6 {
        let at = f64::from(k) * step;
        if at * length <= whole {
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{at}</text>",
                x(at * length),
                bottom + 18.0
            );
        }
    }
    for at in cuts.iter().map(|s| x(*s)) {
        let _ = write!(
            out,
            "<line class=\"cut\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{bottom}\"/>"
        );
    }
    let (mut taken, mut line, mut marks) = (0.0, String::from("M"), String::new());
    let _ = write!(line, "{LEFT} {bottom}");
    for (entry, at) in journal.entries.iter().zip(&times) {
        match &entry.event {
            Event::FrameWritten { .. } => {
                taken += 1.0;
                let _ = write!(line, "L{:.1} {:.1}", x(*at), y(taken));
            }
            Event::Warned { shot, warning } => {
                let _ = write!(
                    marks,
                    "<circle class=\"warned\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"5\"><title>{}: {}</title></circle>",
                    x(*at),
                    y(taken),
                    escape(shot),
                    escape(warning)
                );
            }
            _ => {}
        }
    }
    let _ = write!(
        out,
        "<path class=\"b taken\" d=\"{line}\"/>{marks}\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">time at work, {unit}</text>\
         <text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">pictures</text></svg>",
        (LEFT + right) / 2.0,
        HEIGHT - 6.0,
        (TOP + bottom) / 2.0
    );
    out
}

/// One line a run: when, how long, how many pictures, how it ended.
fn runs(journal: &Recorded) -> String {
    let mut rows = String::new();
    let starts: Vec<usize> = journal
        .entries
        .iter()
        .enumerate()
        .filter(|(_, e)| matches!(e.event, Event::Started { .. }))
        .map(|(i, _)| i)
        .collect();
    for (n, &start) in starts.iter().enumerate() {
        let end = starts.get(n + 1).copied().unwrap_or(journal.entries.len());
        let run = &journal.entries[start..end];
        let frames = run.iter().filter(|e| matches!(e.event, Event::FrameWritten { .. })).count();
        let stopped = run.iter().rev().find_map(|e| match &e.event {
            Event::Stopped { status, reason } => Some((e.unix_s, *status, reason)),
            _ => None,
        });
        let (ended, told) = match &stopped {
            Some((at, StopStatus::Done, _)) => (*at, "done".to_owned()),
            Some((at, StopStatus::Stopped, reason)) => {
                (*at, format!("stopped: {}", escape(reason)))
            }
            Some((at, StopStatus::Failed, reason)) => {
                (*at, format!("<b class=\"clipped\">failed</b>: {}", escape(reason)))
            }
            // Killed, a power cut, or still at it.
            None => (run.last().map_or(0.0, |e| e.unix_s), "its end is not on record".to_owned()),
        };
        let Event::Started { version, camera, projector, .. } = &run[0].event else { continue };
        let devices: Vec<&str> =
            [camera, projector].into_iter().map(String::as_str).filter(|d| !d.is_empty()).collect();
        let _ = write!(
            rows,
            "<tr><td>{}</td><td>{}</td><td>{frames}</td><td>{told}</td><td>{}</td><td>{}</td></tr>",
            utc(run[0].unix_s.max(0.0) as u64),
            duration((ended - run[0].unix_s).max(0.0)),
            escape(devices.join("; ")),
            escape(version)
        );
    }
    format!(
        "<details><summary>{} of the rig</summary><div class=\"wide\"><table><thead><tr><th>begun</th><th>took</th>\
         <th>pictures</th><th>end</th><th>devices</th><th>Diaphane</th></tr></thead>{rows}</table></div></details>",
        counted(starts.len(), "run")
    )
}

/// Warnings and notes, oldest first.
fn words(journal: &Recorded) -> String {
    let line = |entry: &Entry| {
        let told = match &entry.event {
            Event::Warned { shot, warning } => {
                format!("<b>{}</b>: {}", escape(shot), escape(warning))
            }
            Event::Note { text } => escape(text),
            _ => return None,
        };
        Some(format!("<tr><td>{}</td><td>{told}</td></tr>", utc(entry.unix_s.max(0.0) as u64)))
    };
    let all: Vec<String> = journal.entries.iter().filter_map(line).collect();
    if all.is_empty() {
        return String::new();
    }
    let more = match all.len().saturating_sub(MOST) {
        0 => String::new(),
        n => format!("<p class=\"note\">and {n} more, in journal.jsonl</p>"),
    };
    let shown: String = all.into_iter().take(MOST).collect();
    format!(
        "<h3>Warnings and notes</h3><div class=\"wide\"><table class=\"told\">{shown}</table></div>{more}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::{FrameStats, Readback, Warning};

    fn frame() -> Event {
        Event::FrameWritten {
            shot: "a".into(),
            exposure_index: 0,
            repeat: 0,
            file: "frames/a/a-e0-r0.png".into(),
            blake3: String::new(),
            settings: String::new(),
            requested_s: None,
            exposure_s: 0.1,
            device: Readback::default(),
            stats: FrameStats {
                min: 0,
                max: 1,
                mean: 0.5,
                clipped_share: 0.0,
                focus: 0.0,
                patch: None,
            },
        }
    }

    fn started() -> Event {
        let text = String::from("<camera>");
        Event::Started {
            version: "1".into(),
            frames: 2,
            plan: String::new(),
            camera: text,
            projector: String::new(),
        }
    }

    /// A run that was killed after a picture, a night, and a run of 80 s that warns.
    #[test]
    fn runs_warnings_and_pauses_are_told() {
        let warning = Warning::LampDrift { change: 0.02 };
        let (done, reason) = (StopStatus::Done, String::new());
        let events = [
            (0.0, started()),
            (10.0, frame()),
            (40_000.0, started()),
            (40_050.0, frame()),
            (40_060.0, Event::Warned { shot: "a".into(), warning }),
            (40_080.0, Event::Stopped { status: done, reason }),
        ];
        let entry = |(seq, (unix_s, event))| Entry { seq, unix_s, event };
        let entries = (0_u64..).zip(events).map(entry).collect();
        let journal = Recorded { entries, torn_bytes: 0 };
        // 90 s of work; the night takes CUT of that.
        let (times, cuts) = at_work(&journal);
        assert!((times[5] - 91.8).abs() < 1e-9 && cuts.len() == 1, "{times:?}");
        assert!((cuts[0] - 10.9).abs() < 1e-9, "{cuts:?}");
        let told = timeline(&journal).unwrap();
        for text in [
            "2 pictures and 1 warning from 1970-01-01 00:00 UTC to 1970-01-01 11:08 UTC",
            "2 runs of the rig",
            "<td>10 s</td><td>1</td><td>its end is not on record</td><td>&lt;camera&gt;</td>",
            "<td>80 s</td><td>1</td><td>done</td>",
            "the lamp drifts",
        ] {
            assert!(told.contains(text), "{text} in {told}");
        }
        assert_eq!(told.matches("class=\"cut\"").count(), 1);
        assert!(timeline(&Recorded::default()).is_none());
    }
}
