//! Warming up and cooling down of projectors whose protocol knows only on and off.

use std::time::{Duration, Instant};

use super::PowerState;

/// Remembers what a projector was asked for, or announced, so that "off" just after "switch on"
/// is read as warming up.
#[derive(Debug, Default)]
pub(super) struct Transition {
    towards: Option<(PowerState, Instant)>,
}

/// Longer than any lamp needs to warm up or to cool down; what still has not happened by then
/// did not happen.
const LONGEST: Duration = Duration::from_secs(180);

impl Transition {
    /// It was asked, or says that it begins, to go on or off.
    pub fn begin(&mut self, on: bool) {
        let state = if on { PowerState::Warming } else { PowerState::Cooling };
        self.towards = Some((state, Instant::now()));
    }

    /// It has arrived, or given up.
    pub fn end(&mut self) {
        self.towards = None;
    }

    /// On the way, and where to; `None` if settled.
    pub fn state(&mut self) -> Option<PowerState> {
        if self.towards.is_some_and(|(_, since)| since.elapsed() > LONGEST) {
            self.towards = None;
        }
        self.towards.map(|(state, _)| state)
    }

    /// The state of a projector that says whether it is on.
    pub fn resolve(&mut self, on: bool) -> PowerState {
        match (self.state(), on) {
            (Some(PowerState::Warming), false) => PowerState::Warming,
            (Some(PowerState::Cooling), true) => PowerState::Cooling,
            (_, on) => {
                self.end();
                if on { PowerState::On } else { PowerState::Off }
            }
        }
    }
}
