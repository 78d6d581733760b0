//! What of a controller's settings matters here.

/// The settings `$13` and `$22`.
#[derive(Debug, Default)]
pub(super) struct Settings {
    /// Whether it reports inches.
    pub inches: bool,
    /// Whether it has switches to home to.
    pub homing: bool,
}

impl Settings {
    /// Takes one line of the answer to `$$`.
    pub fn set(&mut self, number: u16, value: f64) {
        match number {
            13 => self.inches = value != 0.0,
            22 => self.homing = value != 0.0,
            _ => {}
        }
    }
}
