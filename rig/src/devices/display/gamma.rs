//! The table that a graphics device sends every level through on its way out to a monitor. Night
//! lights and colour profiles bend it, at dusk for example, and no screenshot shows that.

use x11rb::errors::ReplyError;
use x11rb::protocol::randr::{ConnectionExt as _, Crtc};

use super::Monitor;
use super::desktop::Desktop;

/// The table of one output: red, green, blue, 16 bits each.
pub(super) struct Table {
    crtc: Crtc,
    colours: [Vec<u16>; 3],
}

/// One step of 8 bits: servers write level i of 256 as 256 i or as 257 i.
const SAME: u16 = 256;

impl Desktop {
    /// Sees to it that levels go out to the monitor as they are; returns the table that bent them
    /// until now, if one did.
    pub(super) fn straighten(&self, monitor: &Monitor) -> Option<Table> {
        // A server that knows no such tables has none that could bend anything.
        let found = self.table(monitor).ok().flatten()?;
        let straight = straight(found.colours[0].len());
        let same = |colour: &Vec<u16>| {
            colour.len() == straight.len()
                && colour.iter().zip(&straight).all(|(a, b)| a.abs_diff(*b) < SAME)
        };
        if found.colours.iter().all(same) {
            return None;
        }
        self.set_table(&Table { crtc: found.crtc, colours: [(); 3].map(|()| straight.clone()) });
        Some(found)
    }

    /// Puts a table back.
    pub(super) fn set_table(&self, table: &Table) {
        let [red, green, blue] = &table.colours;
        let set = self.connection.randr_set_crtc_gamma(table.crtc, red, green, blue);
        // Checked, so that it has happened when this returns.
        let _ = set.map(|cookie| cookie.check());
    }

    fn table(&self, monitor: &Monitor) -> Result<Option<Table>, ReplyError> {
        let outputs = self.outputs()?;
        let Some(&(crtc, _)) = outputs.iter().find(|(_, at)| at == monitor) else {
            return Ok(None);
        };
        let table = self.connection.randr_get_crtc_gamma(crtc)?.reply()?;
        if table.red.len() < 2 {
            return Ok(None);
        }
        Ok(Some(Table { crtc, colours: [table.red, table.green, table.blue] }))
    }
}

/// Level i of n, of 65535.
fn straight(n: usize) -> Vec<u16> {
    let last = n.saturating_sub(1).max(1) as f64;
    (0..n).map(|i| (i as f64 / last * 65535.0).round() as u16).collect()
}
