//! A projector's remote control, whatever protocol it speaks, and waiting for it to be ready.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::DeviceError;

/// Whether a projector makes light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PowerState {
    /// Stand-by.
    Off,
    /// On its way to [`On`](Self::On).
    Warming,
    /// It shows its input.
    On,
    /// On its way to [`Off`](Self::Off); it takes no orders.
    Cooling,
}

impl std::fmt::Display for PowerState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Warming => "warming up",
            Self::On => "on",
            Self::Cooling => "cooling down",
        })
    }
}

/// The part of a projector that a fault is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// A fan.
    Fan,
    /// The lamp, or whatever makes the light.
    Lamp,
    /// Too hot.
    Temperature,
    /// A cover is open.
    Cover,
    /// The air filter.
    Filter,
    /// Something else.
    Other,
}

/// Whether it still works.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// It works, for now.
    Warning,
    /// It does not.
    Error,
}

/// What a projector says is wrong with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Where.
    pub part: Part,
    /// How bad.
    pub severity: Severity,
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let part = match self.part {
            Part::Fan => "fan",
            Part::Lamp => "lamp",
            Part::Temperature => "temperature",
            Part::Cover => "cover",
            Part::Filter => "filter",
            Part::Other => "another part",
        };
        let severity = match self.severity {
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        write!(f, "{part} {severity}")
    }
}

/// Switches a projector. Every request may be repeated without harm.
///
/// All of them fail with [`DeviceError`] where the projector does not answer, is gone, answers
/// what its protocol does not know, or cannot do that, or cannot do it now.
pub trait ProjectorControl: Send {
    /// Maker and model as far as the projector tells, else the driver's name for it.
    ///
    /// # Errors
    /// See the trait.
    fn name(&mut self) -> Result<String, DeviceError>;

    /// Whether it makes light.
    ///
    /// # Errors
    /// See the trait.
    fn power_state(&mut self) -> Result<PowerState, DeviceError>;

    /// Asks for light, or for none, and returns once the projector has heard it. [`power_on`]
    /// and [`power_off`] wait.
    ///
    /// # Errors
    /// See the trait.
    fn set_power(&mut self, on: bool) -> Result<(), DeviceError>;

    /// Selects the input by the projector's own code for it: `31` in PJLink, `1` in Optoma's
    /// protocol, `30` in Epson's, `hdmi` in BenQ's.
    ///
    /// # Errors
    /// See the trait; `Unsupported` for what is no code of the protocol.
    fn select_input(&mut self, input: &str) -> Result<(), DeviceError>;

    /// Whether picture and sound are muted; `None` where the protocol cannot tell.
    ///
    /// # Errors
    /// See the trait.
    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError>;

    /// Mutes picture and sound, or brings them back. A muted projector is dark but stays warm.
    ///
    /// # Errors
    /// See the trait.
    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError>;

    /// Hours of each lamp.
    ///
    /// # Errors
    /// See the trait.
    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError>;

    /// What is wrong; `None` where the protocol cannot tell.
    ///
    /// # Errors
    /// See the trait.
    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError>;
}

/// Between two questions for the state: lamps take tens of seconds.
const POLL: Duration = Duration::from_millis(500);

/// Switches the projector on and waits until it is, for `limit` at most. `progress` hears the
/// state and the time that has passed, and says whether to go on.
///
/// # Errors
/// `Timeout` past the limit, `Fault` if the projector reports an error, `Declined` if `progress`
/// says no, and whatever the projector answers.
pub fn power_on(
    projector: &mut dyn ProjectorControl,
    limit: Duration,
    progress: &mut dyn FnMut(PowerState, Duration) -> bool,
) -> Result<(), DeviceError> {
    reach(projector, PowerState::On, limit, progress)
}

/// Switches the projector off and waits until it has cooled down. Like [`power_on`].
///
/// # Errors
/// As [`power_on`].
pub fn power_off(
    projector: &mut dyn ProjectorControl,
    limit: Duration,
    progress: &mut dyn FnMut(PowerState, Duration) -> bool,
) -> Result<(), DeviceError> {
    reach(projector, PowerState::Off, limit, progress)
}

fn reach(
    projector: &mut dyn ProjectorControl,
    goal: PowerState,
    limit: Duration,
    progress: &mut dyn FnMut(PowerState, Duration) -> bool,
) -> Result<(), DeviceError> {
    let started = Instant::now();
    // A projector that cools down or warms up takes no orders, so it is asked only when it is
    // settled in the other state, and then once in a while: an order may have come too early.
    let settled = if goal == PowerState::On { PowerState::Off } else { PowerState::On };
    let on_the_way = if goal == PowerState::On { PowerState::Warming } else { PowerState::Cooling };
    let mut asked = false;
    loop {
        let passed = started.elapsed();
        let state = match projector.power_state() {
            Ok(state) => state,
            // Many hear nothing while they warm up or cool down.
            Err(error) if passed < limit && passes(&error, asked) => on_the_way,
            Err(error) => return Err(error),
        };
        if !progress(state, passed) {
            let device = projector.name()?;
            return Err(DeviceError::Declined { device, reason: "stopped while waiting".into() });
        }
        if state == goal {
            return Ok(());
        }
        if state == settled {
            // Whoever falls back after it was asked has a reason; often it knows it.
            if asked {
                fail_on_faults(projector)?;
            }
            match projector.set_power(goal == PowerState::On) {
                Ok(()) => asked = true,
                Err(DeviceError::Busy { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        if passed >= limit {
            fail_on_faults(projector)?;
            let device = projector.name()?;
            return Err(DeviceError::Timeout { device, waited_s: limit.as_secs_f64() });
        }
        std::thread::sleep(POLL.min(limit.saturating_sub(passed)));
    }
}

/// Whether a projector that cannot be asked may be on its way: a silent one only if it has been
/// heard before.
fn passes(error: &DeviceError, asked: bool) -> bool {
    match error {
        DeviceError::Busy { .. } => true,
        DeviceError::Timeout { .. } => asked,
        _ => false,
    }
}

fn fail_on_faults(projector: &mut dyn ProjectorControl) -> Result<(), DeviceError> {
    let faults = projector.faults()?.unwrap_or_default();
    match faults.iter().find(|f| f.severity == Severity::Error) {
        Some(fault) => {
            Err(DeviceError::Fault { device: projector.name()?, reason: fault.to_string() })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceErrorKind;
    use std::collections::VecDeque;

    /// Answers the question for its state with one after the other of these.
    struct Told(VecDeque<Result<PowerState, DeviceErrorKind>>, u32);

    fn error(kind: DeviceErrorKind) -> DeviceError {
        let device = "told".to_owned();
        match kind {
            DeviceErrorKind::Busy => DeviceError::Busy { device },
            _ => DeviceError::Timeout { device, waited_s: 1.0 },
        }
    }

    impl ProjectorControl for Told {
        fn name(&mut self) -> Result<String, DeviceError> {
            Ok("told".into())
        }
        fn power_state(&mut self) -> Result<PowerState, DeviceError> {
            self.0.pop_front().unwrap_or(Ok(PowerState::Warming)).map_err(error)
        }
        fn set_power(&mut self, _: bool) -> Result<(), DeviceError> {
            self.1 += 1;
            Ok(())
        }
        fn select_input(&mut self, _: &str) -> Result<(), DeviceError> {
            Ok(())
        }
        fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
            Ok(None)
        }
        fn set_av_mute(&mut self, _: bool) -> Result<(), DeviceError> {
            Ok(())
        }
        fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
            Ok(Vec::new())
        }
        fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
            Ok(None)
        }
    }

    #[test]
    fn deafness_is_waited_out_after_an_order_and_not_before() {
        use DeviceErrorKind as K;
        let limit = Duration::from_secs(20);
        let states = [Ok(PowerState::Off), Err(K::Timeout), Err(K::Busy), Ok(PowerState::On)];
        let mut projector = Told(states.into(), 0);
        power_on(&mut projector, limit, &mut |_, _| true).unwrap();
        assert_eq!(projector.1, 1);
        let mut silent = Told([Err(K::Timeout), Ok(PowerState::On)].into(), 0);
        let error = power_on(&mut silent, limit, &mut |_, _| true).unwrap_err();
        assert_eq!((error.kind(), silent.1), (K::Timeout, 0));
    }

    #[test]
    fn one_that_never_gets_there_ends_at_the_limit() {
        let mut projector = Told(VecDeque::new(), 0);
        let limit = Duration::from_millis(20);
        let error = power_on(&mut projector, limit, &mut |_, _| true).unwrap_err();
        assert_eq!((error.kind(), projector.1), (DeviceErrorKind::Timeout, 0));
    }
}
