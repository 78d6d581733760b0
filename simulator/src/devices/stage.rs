//! What a stage does when it is told to: axes at a speed, and what may fail.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rig::DeviceError;
use rig::devices::{Coordinate, Stage, StageAxis};

/// What may happen to a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageFailure {
    /// It runs into a limit switch with its next move.
    HitLimit,
    /// A motor loses its steps with the next move, and stops there.
    Stall,
}

#[derive(Clone, Copy, Debug)]
struct Motion {
    from: f64,
    to: f64,
    since: Instant,
}

#[derive(Debug)]
struct State {
    /// Units a second, on every axis.
    speed: f64,
    motions: Vec<Motion>,
    failure: Option<StageFailure>,
    /// What stopped it.
    failed: Option<StageFailure>,
}

impl State {
    /// Where an axis is now, and whether it moves.
    fn at(&mut self, axis: usize) -> (f64, bool) {
        let speed = self.speed;
        let Some(motion) = self.motions.get_mut(axis) else { return (0.0, false) };
        let way = motion.to - motion.from;
        let gone = motion.since.elapsed().as_secs_f64() * speed;
        if gone < way.abs() {
            return (motion.from + gone * way.signum(), true);
        }
        motion.from = motion.to;
        (motion.to, false)
    }
}

/// A stage whose axes move at a speed of their own. Copies are the same stage.
#[derive(Clone, Debug)]
pub struct SimulatedStage {
    state: Arc<Mutex<State>>,
    axes: Vec<StageAxis>,
}

const NAME: &str = "simulated stage";

impl SimulatedStage {
    /// A stage at the origin of all `axes`, which do `speed` mm or degrees a second.
    pub fn new(axes: Vec<StageAxis>, speed: f64) -> Self {
        let rest = Motion { from: 0.0, to: 0.0, since: Instant::now() };
        let state = State { speed, motions: vec![rest; axes.len()], failure: None, failed: None };
        Self { state: Arc::new(Mutex::new(state)), axes }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets `failure` happen.
    pub fn fail(&self, failure: StageFailure) {
        self.state().failure = Some(failure);
    }

    /// Where an axis is, whatever any controller says; 0 for one that there is not.
    pub fn at(&self, axis: usize) -> f64 {
        self.state().at(axis).0
    }

    pub(super) fn count(&self) -> usize {
        self.axes.len()
    }

    pub(super) fn moving(&self, axis: usize) -> bool {
        self.state().at(axis).1
    }

    pub(super) fn any_moving(&self) -> bool {
        (0..self.count()).any(|axis| self.moving(axis))
    }

    /// Sets out; an axis that moves turns from where it is.
    pub(super) fn go(&self, axis: usize, to: f64) {
        let mut state = self.state();
        let (from, _) = state.at(axis);
        // Half of the way is where things go wrong.
        let to = match state.failure.take() {
            None => to,
            Some(failure) => {
                state.failed = Some(failure);
                from + (to - from) / 2.0
            }
        };
        if let Some(motion) = state.motions.get_mut(axis) {
            *motion = Motion { from, to, since: Instant::now() };
        }
    }

    /// Comes to rest where it is.
    pub(super) fn rest(&self) {
        let mut state = self.state();
        for axis in 0..state.motions.len() {
            let (at, _) = state.at(axis);
            if let Some(motion) = state.motions.get_mut(axis) {
                *motion = Motion { from: at, to: at, since: Instant::now() };
            }
        }
    }

    /// What stopped it, once it has come to rest.
    pub(super) fn failed(&self) -> Option<StageFailure> {
        if self.any_moving() { None } else { self.state().failed }
    }

    pub(super) fn mend(&self) {
        self.state().failed = None;
    }

    fn fault(&self) -> Result<(), DeviceError> {
        let reason = match self.failed() {
            None => return Ok(()),
            Some(StageFailure::HitLimit) => "a limit switch was hit",
            Some(StageFailure::Stall) => "stalled",
        };
        Err(DeviceError::Fault { device: NAME.into(), reason: reason.into() })
    }

    fn axis(&self, axis: usize) -> Result<&StageAxis, DeviceError> {
        self.axes.get(axis).ok_or_else(|| DeviceError::Unsupported {
            device: NAME.into(),
            reason: format!("there is no axis number {axis}"),
        })
    }

    fn wait(&self, limit: Duration) -> Result<(), DeviceError> {
        let started = Instant::now();
        while self.any_moving() {
            if started.elapsed() > limit {
                self.rest();
                let waited_s = limit.as_secs_f64();
                return Err(DeviceError::Timeout { device: NAME.into(), waited_s });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        self.fault()
    }
}

impl Stage for SimulatedStage {
    fn name(&self) -> String {
        NAME.into()
    }

    fn axes(&self) -> &[StageAxis] {
        &self.axes
    }

    fn position(&mut self, axis: usize) -> Result<Coordinate, DeviceError> {
        self.fault()?;
        let origin = self.axis(axis)?.range.ends().0;
        Ok(origin.at(self.at(axis)))
    }

    fn move_to(&mut self, axis: usize, to: Coordinate, limit: Duration) -> Result<(), DeviceError> {
        self.fault()?;
        let to = self.axis(axis)?.admit(NAME, to)?;
        self.go(axis, to);
        self.wait(limit)
    }

    fn hold(&mut self) -> Result<(), DeviceError> {
        self.rest();
        Ok(())
    }

    fn halt(&mut self) -> Result<(), DeviceError> {
        self.rest();
        Ok(())
    }

    fn home(&mut self, limit: Duration) -> Result<(), DeviceError> {
        self.mend();
        for axis in 0..self.count() {
            self.go(axis, 0.0);
        }
        self.wait(limit)
    }

    fn unlock(&mut self) -> Result<(), DeviceError> {
        self.mend();
        Ok(())
    }
}
