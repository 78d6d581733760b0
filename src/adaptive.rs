//! Exposures of a session that follow from its first pictures.
//!
//! The plan begins with black and one pattern at every exposure of the bracket. What that pattern
//! looks like, and the camera's noise, choose the exposures of all others; the choice is a file of
//! the session, so that a capture that is taken up again makes the same. Once all is taken, a
//! pattern that is clipped in its shortest exposure gets the bracket's shorter ones too.

use crate::Failure;
use crate::commands::calibrate::{self, Calibrated, frame_and_time, merge_shot, subtract};
use crate::measurement::lit_directly;
use crate::sensor::Sensor;
use crate::session::Session;
use calibration::{HdrImage, NoiseModel, Response, rectify};
use material::{Input, Overwrite};
use rig::{
    ChannelBrightness, ExposureChoice, FrameNoise, NoiseGoal, Outcome, Pattern, Plan, Purpose,
    SampleScheme, Shot, choose_exposures, frame_path,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The choice, in a session.
pub(crate) const CHOICE: &str = "exposures.json";

/// A twentieth more noise is not told from equal noise; a thousandth of the cells may be glints;
/// a later pattern may be a stop brighter.
pub(crate) const GOAL: NoiseGoal = NoiseGoal { tolerance: 1.05, left_out: 1e-3, head_room: 2.0 };

/// How a session comes to the exposures of its sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Brackets {
    /// The whole bracket for every pattern
    #[default]
    Full,
    /// What the first pattern shows to be enough
    Adaptive,
}

/// [`rig::SampleScheme`] on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum SchemeName {
    /// One region after the other
    Regions,
    /// About half of all regions at a time: less noise where the camera's own rules
    Multiplexed,
}

impl From<SchemeName> for SampleScheme {
    fn from(name: SchemeName) -> Self {
        match name {
            SchemeName::Regions => Self::Regions,
            SchemeName::Multiplexed => Self::Multiplexed,
        }
    }
}

/// The exposures that were chosen, and what they rest on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Chosen {
    /// The bracket that they are a part of, seconds.
    bracket_s: Vec<f64>,
    pub choice: ExposureChoice,
    /// The shot that was looked at, and what it showed.
    shot: String,
    pattern: Pattern,
    goal: NoiseGoal,
    /// What the solver adds to the noise, as a share of a picture's brightest cell.
    model_error: f64,
    /// Pixels whose mean is as noisy as a cell of the grid.
    pixels_per_cell: f64,
    channels: Vec<Basis>,
    inputs: Vec<Input>,
    /// The bracket's shorter exposures, by pattern, for patterns that the chosen ones clip; None
    /// until all have been looked at.
    extended_s: Option<BTreeMap<String, Vec<f64>>>,
}

/// What one channel of the first pattern looked like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Basis {
    noise: FrameNoise,
    /// Of a pixel, full scales a second.
    floor: f64,
    /// Darkest and brightest cell, full scales a second.
    radiances: [f64; 2],
}

impl Chosen {
    /// The session's choice, None if there is none yet.
    pub fn read(session: &Session) -> Result<Option<Self>, Failure> {
        let path = session.path(CHOICE);
        if session.config.plan.brackets == Brackets::Full || !path.exists() {
            return Ok(None);
        }
        let move_aside =
            || format!("move {} aside; diaphane capture makes it again", path.display());
        let found: Self = session
            .read_json(CHOICE, "diaphane capture SESSION")
            .map_err(|e| e.hint(move_aside()))?;
        let asked = session.sample_bracket_s();
        let changed = |what: &str| {
            let error =
                format!("{}: chosen for another {what} than session.toml has now", path.display());
            Err(Failure::input(error).hint(session.branch_hint()))
        };
        if found.bracket_s != asked {
            return changed(&format!("bracket ({:?} s, not {asked:?} s)", found.bracket_s));
        }
        let plan = session.acquisition().capture_plan();
        if plan.shots.get(SEEN_IN_FULL - 1).is_none_or(|seen| seen.pattern != found.pattern) {
            return changed("first pattern");
        }
        let extended = found.extended_s.iter().flat_map(BTreeMap::values).flatten();
        let mut times = found.choice.exposures_s.iter().chain(extended);
        if found.choice.exposures_s.is_empty() || !times.all(|t| asked.contains(t)) {
            let error = format!(
                "{}: expected exposures of the bracket {asked:?} s, found {:?} s and {:?}",
                path.display(),
                found.choice.exposures_s,
                found.extended_s
            );
            return Err(Failure::input(error).hint(move_aside()));
        }
        Ok(Some(found))
    }

    /// Whether every pattern has been looked at.
    fn settled(&self) -> bool {
        self.extended_s.is_some()
    }

    /// Gives all shots after the first pattern their exposures.
    fn apply(&self, plan: &mut Plan) {
        for shot in plan.shots.iter_mut().skip(SEEN_IN_FULL) {
            shot.exposures_s.clone_from(&self.choice.exposures_s);
            let more = self.extended_s.as_ref().and_then(|all| all.get(&shot.name));
            // Behind the others, so that frames that are there keep their names.
            shot.exposures_s.extend(more.into_iter().flatten());
        }
    }
}

/// Black and the first pattern.
const SEEN_IN_FULL: usize = 2;

/// The plan of the sample as far as it is known: where the exposures are still to be chosen, the
/// whole bracket, which is the most that it can come to.
pub(crate) fn sample_plan(session: &Session) -> Result<Plan, Failure> {
    let mut plan = session.acquisition().capture_plan();
    if let Some(chosen) = Chosen::read(session)? {
        chosen.apply(&mut plan);
    }
    Ok(plan)
}

/// Whether the plan of the sample will not change any more.
pub(crate) fn is_settled(session: &Session) -> Result<bool, Failure> {
    Ok(session.config.plan.brackets == Brackets::Full
        || Chosen::read(session)?.is_some_and(|chosen| chosen.settled()))
}

/// Takes the pictures of the sample with `shoot`, which carries a plan out.
pub(crate) fn take(
    session: &Session,
    mut shoot: impl FnMut(&Plan) -> Result<Outcome, Failure>,
) -> Result<Outcome, Failure> {
    if session.config.plan.brackets == Brackets::Full {
        return shoot(&sample_plan(session)?);
    }
    let mut taken = 0;
    let mut chosen = match Chosen::read(session)? {
        Some(chosen) => chosen,
        None => {
            let mut first = sample_plan(session)?;
            first.shots.truncate(SEEN_IN_FULL);
            taken += shoot(&first)?.taken;
            let chosen = choose(session)?;
            session.write_json(CHOICE, &chosen, Overwrite::Refuse)?;
            eprintln!("exposures: {}", text(&chosen.choice));
            chosen
        }
    };
    let mut outcome = shoot(&sample_plan(session)?)?;
    taken += outcome.taken;
    if !chosen.settled() {
        chosen.extended_s = Some(clipped(session, &chosen)?);
        session.write_json(CHOICE, &chosen, Overwrite::Replace)?;
        if chosen.extended_s.as_ref().is_some_and(|more| !more.is_empty()) {
            outcome = shoot(&sample_plan(session)?)?;
            taken += outcome.taken;
        }
    }
    let frames: usize = sample_plan(session)?.shots.iter().map(Shot::frames).sum();
    Ok(Outcome { taken, kept: frames.saturating_sub(taken), ..outcome })
}

/// The choice in a sentence.
pub(crate) fn text(choice: &ExposureChoice) -> String {
    let times: Vec<String> = choice.exposures_s.iter().map(|t| format!("{t:.3}")).collect();
    format!(
        "{} s do for every pattern, in {:.1} s where the bracket takes {:.1} s",
        times.join(" "),
        choice.time_s,
        choice.bracket_time_s
    )
}

/// Chooses from the first pattern, which is there.
fn choose(session: &Session) -> Result<Chosen, Failure> {
    let found = calibrate::load(session)?;
    let sensor = Sensor::of(session)?;
    let plan = session.acquisition().capture_plan();
    let [black, seen, ..] = plan.shots.as_slice() else {
        return Err(Failure::other("a plan without a pattern"));
    };
    let bracket_s = session.sample_bracket_s();
    let merged =
        |shot: &Shot| merge_shot(session, &shot.name, &shot.exposures_s, &found.response, &sensor);
    let image = merged(seen)?;
    let even = HdrImage { variance: vec![1.0; image.variance.len()], ..image.clone() };
    let usable = Cells::of(session, &found, seen)?;
    let with_dark = usable.map(&image, &found)?;
    let noise_share = usable.map(&even, &found)?;
    let light = usable.map(&subtract(image, &merged(black)?), &found)?;
    let mut shares: Vec<f64> = noise_share.iter().flatten().map(|(_, v)| *v).collect();
    shares.sort_by(f64::total_cmp);
    let pixels_per_cell = shares.get(shares.len() / 2).map_or(1.0, |v| 1.0 / v);
    let model_error = diffusion::InverseSettings::default().model_error;
    let channels: Vec<ChannelBrightness> = with_dark
        .iter()
        .zip(&light)
        .enumerate()
        .map(|(c, (all, light))| {
            let brightest = light.iter().map(|(l, _)| *l).fold(0.0, f64::max);
            ChannelBrightness {
                noise: frame_noise(sensor.noise(), &found.response, c),
                radiances: all.iter().map(|(l, _)| *l).collect(),
                floor: model_error * brightest * pixels_per_cell.sqrt(),
            }
        })
        .collect();
    let choice = choose_exposures(&channels, &bracket_s, rig::PER_FRAME_S, &GOAL).map_err(|e| {
        Failure::input(format!("shot {:?}: {e}", seen.name)).hint(
            "give session.toml a bracket that suits the block, or brackets = \"full\", in a new session",
        )
    })?;
    let basis = |c: &ChannelBrightness| Basis {
        noise: c.noise,
        floor: c.floor,
        radiances: [
            c.radiances.iter().copied().fold(f64::INFINITY, f64::min),
            c.radiances.iter().copied().fold(0.0, f64::max),
        ],
    };
    let frames = [black, seen]
        .into_iter()
        .flat_map(|shot| (0..shot.exposures_s.len()).map(move |e| frame_path(&shot.name, e, 0)));
    let inputs = frames
        .chain([calibrate::RESULT.to_owned()])
        .map(|name| Ok(Input::from_file(&name, &session.path(&name))?))
        .collect::<Result<_, Failure>>()?;
    Ok(Chosen {
        bracket_s,
        choice,
        shot: seen.name.clone(),
        pattern: seen.pattern.clone(),
        goal: GOAL,
        model_error,
        pixels_per_cell,
        channels: channels.iter().map(basis).collect(),
        inputs,
        extended_s: None,
    })
}

/// The noise model in the merge's unit, linearised full scales above black.
pub(crate) fn frame_noise(noise: &NoiseModel, response: &Response, channel: usize) -> FrameNoise {
    let share = |code: f64| code / noise.full_scale;
    let slope = response.slope(share(noise.black_level), channel) / noise.full_scale;
    let black = response.linearise(share(noise.black_level), channel);
    FrameNoise {
        dark: (noise.read_noise.powi(2) + 1.0 / 12.0).sqrt() * slope,
        photons: noise.gain / noise.full_scale,
        saturation: response.linearise(share(noise.saturation), channel) - black,
    }
}

/// The patterns that are clipped in the shortest of the chosen exposures, and the shorter ones of
/// the bracket.
fn clipped(session: &Session, chosen: &Chosen) -> Result<BTreeMap<String, Vec<f64>>, Failure> {
    let Some(&shortest_s) = chosen.choice.exposures_s.first() else { return Ok(BTreeMap::new()) };
    let mut shorter: Vec<f64> =
        chosen.bracket_s.iter().copied().filter(|t| *t < shortest_s).collect();
    shorter.sort_by(f64::total_cmp);
    if shorter.is_empty() {
        return Ok(BTreeMap::new());
    }
    let found = calibrate::load(session)?;
    let saturation = Sensor::of(session)?.noise().saturation;
    let mut out = BTreeMap::new();
    for shot in sample_plan(session)?.shots.iter().skip(SEEN_IN_FULL) {
        let (photo, _) = frame_and_time(session, &shot.name, 0, 0)?;
        let full =
            photo.data.iter().map(|code| f64::from(u8::from(f64::from(*code) >= saturation)));
        let image = HdrImage {
            width: photo.width,
            height: photo.height,
            channels: photo.channels,
            radiance: full.map(|v| v as f32).collect(),
            variance: vec![1.0; photo.data.len()],
            variance_known: false,
            clipped_shortest: 0,
            lost_longest: 0,
        };
        let most = Cells::of(session, &found, shot)?
            .map(&image, &found)?
            .iter()
            .map(|cells| {
                let touched = cells.iter().filter(|(share, _)| *share > 0.0).count();
                touched as f64 / cells.len().max(1) as f64
            })
            .fold(0.0, f64::max);
        if most > GOAL.left_out {
            eprintln!(
                "{}: {:.1} % of its cells are clipped at {shortest_s:.3} s: {} shorter exposures follow",
                shot.name,
                100.0 * most,
                shorter.len()
            );
            out.insert(shot.name.clone(), shorter.clone());
        }
    }
    Ok(out)
}

/// The cells of the front face that a pattern's picture tells something of.
struct Cells {
    cells: [usize; 2],
    spacing_mm: [f64; 2],
    /// Those lit directly, from the front, tell nothing but of the surface.
    usable: Vec<bool>,
}

impl Cells {
    fn of(session: &Session, found: &Calibrated, shot: &Shot) -> Result<Self, Failure> {
        let grid = &session.config.sample.grid;
        let ([nx, ny, _], [hx, hy, _]) = (grid.cells(), grid.spacing_mm());
        let irradiance = irradiance(shot, found, [nx, ny])?;
        let usable = match shot.purpose {
            Purpose::Surface => vec![true; nx * ny],
            _ => {
                let lit = lit_directly(session.config.sample.lit_face, [nx, ny], &irradiance);
                lit.iter().map(|lit| !lit).collect()
            }
        };
        Ok(Self { cells: [nx, ny], spacing_mm: [hx, hy], usable })
    }

    /// Radiance and variance of the usable cells that could be measured, one list a channel.
    fn map(&self, image: &HdrImage, found: &Calibrated) -> Result<Vec<Vec<(f64, f64)>>, Failure> {
        let map = rectify(image, &found.front, self.cells, self.spacing_mm)?;
        let pairs: Vec<(f64, f64)> = map
            .radiance
            .iter()
            .zip(&map.variance)
            .map(|(l, v)| (f64::from(*l), f64::from(*v)))
            .collect();
        let channel = |cells: &[(f64, f64)]| {
            let measured = cells.iter().zip(&self.usable);
            measured.filter(|((_, v), usable)| **usable && v.is_finite()).map(|(c, _)| *c).collect()
        };
        Ok(pairs.chunks(self.usable.len().max(1)).map(channel).collect())
    }
}

/// Irradiance of a shot's pattern on the cells of the lit face.
pub(crate) fn irradiance(
    shot: &Shot,
    found: &Calibrated,
    [nx, ny]: [usize; 2],
) -> Result<Vec<f64>, Failure> {
    let coverage = shot.pattern.coverage(nx, ny).ok_or_else(|| {
        Failure::input(format!("shot {:?}: its pattern does not lie on the face", shot.name))
    })?;
    Ok(coverage.iter().zip(&found.irradiance).map(|(c, e)| f64::from(*c) * e).collect())
}
