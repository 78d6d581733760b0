//! Takes the calibration pictures in the right order, says what goes where, and looks at each
//! picture at once.

use super::all::{described, is_done};
use super::boards::projected_points;
use super::frames::frame_photo;
use crate::Failure;
use crate::cli::STOP;
use crate::commands::capture::{asked_for, interrupted, remark};
use crate::session::Session;
use crate::technician::answer;
use calibration::{Board, Photo, detect_board};
use material::Face;
use rig::{Pattern, Plan, Purpose, Rig, RunOptions, Shot, Step, Target};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};

/// Light squares clipped beyond this share move their corners.
const MOST_CLIPPED: f64 = 0.1;
/// A bracket whose brightest frame stays below this share of full scale wastes the sensor.
const DARKEST: f64 = 0.1;

/// Takes what is missing; returns what was wrong with pictures that were kept all the same.
///
/// Where a person sits at a terminal, a picture that is no good is taken again on request; else it
/// is a warning, and the calibration decides whether it can do without.
pub(super) fn take(session: &Session, rig: &mut Rig) -> Result<Vec<String>, Failure> {
    let plan = session.acquisition().calibration_plan();
    let board = described(session)?.0;
    let interactive = std::io::stdin().is_terminal();
    let force = if is_done(session) { " --force" } else { "" };
    let command = session.command(&format!("calibrate all SESSION{force}"));
    let placements = placements(&plan);
    let mut complaints = Vec::new();
    loop {
        let stop = AtomicBool::new(false);
        // Ctrl-C is seen at once, in a wait too; the other flag is this loop's own.
        let options = RunOptions { other_stop: Some(&stop), ..RunOptions::new(&STOP) };
        let mut bad: Option<(&Shot, String)> = None;
        let mut broken = None;
        let mut asked = None;
        let outcome = rig::run(&plan, rig, session.folder(), options, &mut |p| {
            asked = asked_for(asked, &p.step);
            if let Some(remark) = remark(&p) {
                eprintln!("{remark}");
            }
            let shot = plan.shots.iter().find(|s| s.name == p.shot);
            match (&p.step, shot) {
                (Step::Placing(target), _) => {
                    let number = placements.iter().position(|t| t == target).unwrap_or(0) + 1;
                    eprintln!("[{number}/{}] place {target}", placements.len());
                }
                (Step::Taken, Some(shot)) if is_last(&plan, shot, p.done) => {
                    match look(session, shot, &board) {
                        Ok(Ok(word)) => eprintln!("  {:14} {word}", shot.name),
                        Ok(Err(why)) => {
                            eprintln!("  {:14} NO GOOD: {why}", shot.name);
                            if interactive {
                                bad = Some((shot, why));
                                stop.store(true, Ordering::Relaxed);
                            } else {
                                complaints.push(format!("{}: {why}", shot.name));
                            }
                        }
                        Err(failure) => {
                            broken.get_or_insert(failure);
                            stop.store(true, Ordering::Relaxed);
                        }
                    }
                }
                _ => {}
            }
        })
        .map_err(|e| session.run_failure(e))?;
        if let Some(failure) = broken {
            return Err(failure);
        }
        if let Some((shot, why)) = bad {
            match again() {
                Some(true) => rig::set_aside(session.folder(), shot)?,
                Some(false) => complaints.push(format!("{}: {why}", shot.name)),
                None => return Err(interrupted(None, &outcome, &command)),
            }
            continue;
        }
        if outcome.missing > 0 {
            return Err(interrupted(asked, &outcome, &command));
        }
        return Ok(complaints);
    }
}

/// Whether to take the picture again, asked on the terminal; `None` where they stop instead.
fn again() -> Option<bool> {
    eprintln!(
        "  mend it and press Enter to take it again; k and Enter keeps it; q and Enter stops"
    );
    answer().map(|answer| answer != "k")
}

/// What is put on the bench, in order, each once.
fn placements(plan: &Plan) -> Vec<Target> {
    let mut out: Vec<Target> = Vec::new();
    for shot in &plan.shots {
        if !out.contains(&shot.target) {
            out.push(shot.target);
        }
    }
    out
}

/// Whether `done` frames of the plan end with the last one of a shot.
fn is_last(plan: &Plan, shot: &Shot, done: usize) -> bool {
    let before = plan.shots.iter().take_while(|s| s.name != shot.name).map(Shot::frames);
    before.sum::<usize>() + shot.frames() == done
}

/// A word on a shot that is good, or what is wrong with it.
fn look(session: &Session, shot: &Shot, board: &Board) -> Result<Result<String, String>, Failure> {
    let last = shot.exposures_s.len().saturating_sub(1);
    match (&shot.target, &shot.pattern) {
        (Target::Board { .. } | Target::FaceBoard { .. }, _) => {
            Ok(board_word(&frame_photo(session, &shot.name, 0)?, board))
        }
        (_, Pattern::Chessboard(shown)) => {
            let photo = frame_photo(session, &shot.name, 0)?;
            let mirrored = session.config.sample.lit_face == Face::Back;
            Ok(match projected_points(&photo, shown, mirrored) {
                Ok(points) => Ok(format!("{} projected corners", points.len())),
                Err(error) => Err(error.to_string()),
            })
        }
        (_, Pattern::White) if shot.purpose != Purpose::Geometry => {
            let (short, long) =
                (frame_photo(session, &shot.name, 0)?, frame_photo(session, &shot.name, last)?);
            Ok(bracket_word(&short, &long))
        }
        _ => Ok(Ok("taken".into())),
    }
}

fn board_word(photo: &Photo, board: &Board) -> Result<String, String> {
    let found = detect_board(photo, board).map_err(|e| e.to_string())?;
    let quality = &found.quality;
    if quality.clipped_share > MOST_CLIPPED {
        let share = 100.0 * quality.clipped_share;
        return Err(format!("{share:.0} % of its light squares are clipped: expose it less"));
    }
    let dropped = match found.dropped.len() {
        0 => String::new(),
        n => format!(", {n} out of line and left out"),
    };
    Ok(format!(
        "{} corners, edges {:.1} px wide, tilted by {:.0} degrees{dropped}",
        found.corners.len(),
        quality.edge_width_px,
        quality.tilt_rad.to_degrees()
    ))
}

/// A bracket must hold the brightest thing unclipped and lift it well out of the dark.
fn bracket_word(short: &Photo, long: &Photo) -> Result<String, String> {
    let full = f64::from(short.max_value);
    let share = |photo: &Photo, test: &dyn Fn(f64) -> bool| {
        let count = photo.data.iter().filter(|v| test(f64::from(**v) / full)).count();
        count as f64 / photo.data.len().max(1) as f64
    };
    let clipped = share(short, &|v| v >= 0.995);
    if clipped > 0.001 {
        let clipped = 100.0 * clipped;
        return Err(format!("{clipped:.1} % is clipped even at the shortest exposure"));
    }
    let bright = share(long, &|v| v > DARKEST);
    if bright < 0.01 {
        return Err("dark even at the longest exposure: is the projector on?".into());
    }
    Ok("nothing clipped at the shortest exposure, light enough at the longest".into())
}
