//! What stands on a screen, by a program of somebody else's.

use rig::ProjectorImage;
use std::process::Command;

/// Takes a picture of all of an X server's screen.
pub fn screenshot(server: &str) -> Screenshot {
    let output = Command::new("import")
        .args(["-display", server, "-window", "root", "-depth", "8", "ppm:-"])
        .output()
        .expect("import, of ImageMagick");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "import: {error}");
    // P6, width and height, and 255, a line each; then R, G, B a pixel.
    let mut parts = output.stdout.splitn(4, |byte| *byte == b'\n');
    assert_eq!(parts.next(), Some(&b"P6"[..]));
    let size = String::from_utf8_lossy(parts.next().unwrap());
    assert_eq!(parts.next(), Some(&b"255"[..]));
    let width = size.split_once(' ').unwrap().0.parse().unwrap();
    Screenshot { width, data: parts.next().unwrap().to_vec() }
}

/// Pixels of a screen.
pub struct Screenshot {
    width: usize,
    data: Vec<u8>,
}

impl Screenshot {
    /// Pixels of the rectangle at (x, y) that are not as in `image`, its grey level in all three
    /// channels.
    pub fn wrong(&self, image: &ProjectorImage, x: usize, y: usize) -> usize {
        let columns = image.width as usize;
        let lines =
            image.data.chunks_exact(columns).zip(self.data.chunks_exact(3 * self.width).skip(y));
        let wrong = |(wanted, line): (&[u8], &[u8])| {
            let found = line[3 * x..3 * (x + columns)].chunks_exact(3);
            wanted.iter().zip(found).filter(|(level, rgb)| rgb.iter().any(|v| v != *level)).count()
        };
        lines.map(wrong).sum()
    }
}
