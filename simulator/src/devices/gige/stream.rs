//! A frame as packets: the GigE Vision Streaming Protocol (GigE Vision 1.2, chapters 21 and 24).

use std::net::{SocketAddrV4, UdpSocket};
use std::time::Duration;

use rand::{Rng, RngExt};

/// A frame to be sent.
pub struct Picture<'a> {
    /// PFNC code.
    pub format: u32,
    pub width: u32,
    pub height: u32,
    pub offset: [u32; 2],
    pub bytes: &'a [u8],
}

/// Headers of IP, UDP and the protocol itself, which count as part of a packet.
const OVERHEAD: usize = 20 + 8 + 8;
/// A slow receiver's memory holds that much, and it wakes up within that time: half of what Linux
/// gives a socket if it is not asked for more, sixty megabytes a second.
const BURST: usize = 64 * 1024;
const PAUSE: Duration = Duration::from_millis(1);

const LEADER: u8 = 1;
const TRAILER: u8 = 2;
const PAYLOAD: u8 = 3;

/// Sends a frame under a number that is not 0, in packets of `size` bytes; each is lost with the
/// probability `lost`.
pub fn send(
    socket: &UdpSocket,
    to: SocketAddrV4,
    number: u16,
    size: usize,
    picture: &Picture<'_>,
    lost: f64,
    chance: &mut impl Rng,
) -> std::io::Result<()> {
    let room = size.saturating_sub(OVERHEAD).max(1);
    let mut packets = vec![(LEADER, leader(picture))];
    packets.extend(picture.bytes.chunks(room).map(|part| (PAYLOAD, part.to_vec())));
    packets.push((TRAILER, trailer(picture)));
    let mut since = 0;
    for (id, (kind, content)) in packets.iter().enumerate() {
        if since > BURST {
            std::thread::sleep(PAUSE);
            since = 0;
        }
        since += content.len() + OVERHEAD;
        if chance.random_bool(lost) {
            continue;
        }
        let mut packet = vec![0, 0];
        packet.extend(number.to_be_bytes());
        let id = (id as u32).to_be_bytes();
        packet.extend([*kind, id[1], id[2], id[3]]);
        packet.extend(content);
        socket.send_to(&packet, to)?;
    }
    Ok(())
}

fn leader(picture: &Picture<'_>) -> Vec<u8> {
    // An image; no time stamp.
    let mut bytes = vec![0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0];
    let [x, y] = picture.offset;
    for value in [picture.format, picture.width, picture.height, x, y] {
        bytes.extend(value.to_be_bytes());
    }
    // No padding.
    bytes.extend([0; 4]);
    bytes
}

fn trailer(picture: &Picture<'_>) -> Vec<u8> {
    let mut bytes = vec![0, 0, 0, 1];
    bytes.extend(picture.height.to_be_bytes());
    bytes
}
