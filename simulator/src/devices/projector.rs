//! What a projector does when it is told to: lamp, input, mute, and what may fail.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rig::DeviceError;
use rig::devices::{Fault, Part, PowerState, ProjectorControl, Severity};

/// What a simulated projector is like.
#[derive(Clone, Debug, PartialEq)]
pub struct ProjectorSpec {
    /// From "on" until there is light.
    pub warm_up: Duration,
    /// From "off" until it takes orders again.
    pub cool_down: Duration,
    /// Hours of its lamp.
    pub lamp_hours: u32,
}

impl Default for ProjectorSpec {
    /// One whose lamp is a matter of a second: nobody wants to wait for what is not there.
    fn default() -> Self {
        let second = Duration::from_secs(1);
        Self { warm_up: second, cool_down: second, lamp_hours: 1234 }
    }
}

#[derive(Debug)]
struct State {
    spec: ProjectorSpec,
    /// Where it is going, and since when.
    towards: PowerState,
    since: Instant,
    mute: bool,
    input: String,
    faults: Vec<Fault>,
    /// Orders that it will still refuse as busy.
    busy: u32,
    /// Whether its lamp lights.
    lamp_fails: bool,
}

impl State {
    fn power(&mut self) -> PowerState {
        let passed = self.since.elapsed();
        match self.towards {
            PowerState::Warming if passed >= self.spec.warm_up => {
                self.towards = if self.lamp_fails {
                    self.faults = vec![Fault { part: Part::Lamp, severity: Severity::Error }];
                    PowerState::Off
                } else {
                    PowerState::On
                };
            }
            PowerState::Cooling if passed >= self.spec.cool_down => self.towards = PowerState::Off,
            _ => {}
        }
        self.towards
    }
}

/// A projector without a picture: the part that is switched. Copies are the same projector, so
/// that one can be behind a wire and another in the hands of a test.
#[derive(Clone, Debug)]
pub struct SimulatedProjector(Arc<Mutex<State>>);

impl SimulatedProjector {
    /// A projector in stand-by.
    pub fn new(spec: ProjectorSpec) -> Self {
        Self(Arc::new(Mutex::new(State {
            spec,
            towards: PowerState::Off,
            since: Instant::now(),
            mute: false,
            input: String::new(),
            faults: Vec::new(),
            busy: 0,
            lamp_fails: false,
        })))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets it refuse the next `orders` orders as busy.
    pub fn be_busy(&self, orders: u32) {
        self.state().busy = orders;
    }

    /// Lets its lamp fail to light from now on.
    pub fn break_lamp(&self) {
        self.state().lamp_fails = true;
    }

    /// Lets it report a fault.
    pub fn report(&self, fault: Fault) {
        self.state().faults.push(fault);
    }

    /// The input that was selected last.
    pub fn input(&self) -> String {
        self.state().input.clone()
    }

    /// Whether it takes an order now: on, and not busy.
    pub(super) fn ready(&self) -> bool {
        let mut state = self.state();
        if state.busy > 0 {
            state.busy -= 1;
            return false;
        }
        state.power() == PowerState::On
    }

    pub(super) fn power(&self) -> PowerState {
        self.state().power()
    }

    /// Switches; false while it warms up, cools down or is busy.
    pub(super) fn switch(&self, on: bool) -> bool {
        let mut state = self.state();
        if state.busy > 0 {
            state.busy -= 1;
            return false;
        }
        let next = match (state.power(), on) {
            (PowerState::Off, true) => PowerState::Warming,
            (PowerState::On, false) => PowerState::Cooling,
            (PowerState::Off, false) | (PowerState::On, true) => return true,
            _ => return false,
        };
        state.towards = next;
        state.since = Instant::now();
        state.mute = false;
        true
    }

    pub(super) fn mute(&self) -> bool {
        self.state().mute
    }

    pub(super) fn set_mute(&self, mute: bool) {
        self.state().mute = mute;
    }

    pub(super) fn set_input(&self, input: &str) {
        self.state().input = input.to_owned();
    }

    pub(super) fn hours(&self) -> u32 {
        self.state().spec.lamp_hours
    }

    pub(super) fn reported(&self) -> Vec<Fault> {
        let mut state = self.state();
        state.power();
        state.faults.clone()
    }

    fn busy(&self) -> DeviceError {
        DeviceError::Busy { device: NAME.into() }
    }
}

const NAME: &str = "simulated projector";

impl ProjectorControl for SimulatedProjector {
    fn name(&mut self) -> Result<String, DeviceError> {
        Ok(NAME.into())
    }

    fn power_state(&mut self) -> Result<PowerState, DeviceError> {
        Ok(self.power())
    }

    fn set_power(&mut self, on: bool) -> Result<(), DeviceError> {
        if self.switch(on) { Ok(()) } else { Err(self.busy()) }
    }

    fn select_input(&mut self, input: &str) -> Result<(), DeviceError> {
        if !self.ready() {
            return Err(self.busy());
        }
        self.set_input(input);
        Ok(())
    }

    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
        Ok(Some(self.mute()))
    }

    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError> {
        if !self.ready() {
            return Err(self.busy());
        }
        self.set_mute(mute);
        Ok(())
    }

    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
        Ok(vec![self.hours()])
    }

    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
        Ok(Some(self.reported()))
    }
}
