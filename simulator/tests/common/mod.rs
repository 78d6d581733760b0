//! What the tests of projectors and of stages share.

use std::time::Duration;

use rig::devices::Patience;

/// A second is much for an answer of a few bytes, and little for a machine with other things to do.
pub const PATIENCE: Patience =
    Patience { reply: Duration::from_secs(1), attempts: 3, pause: Duration::from_millis(30) };

/// Waiting is most of what these tests do, so they wait for all protocols at once.
pub fn for_each_protocol(protocols: &[&'static str], test: impl Fn(&'static str) + Sync) {
    std::thread::scope(|scope| {
        for protocol in protocols {
            let test = &test;
            scope.spawn(move || test(protocol));
        }
    });
}
