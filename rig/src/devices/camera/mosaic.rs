//! From a sensor that sees one colour a pixel to linear red, green and blue, nothing invented.

use raw::Bayer;

/// Red, green and blue of each quad of `values`, `columns` a row: half the width and height, and no
/// value that was not measured. Green is the mean of the quad's two, half a number rounded to the
/// even one so that no mean drifts; where either has reached `max`, so has their mean, or a clipped
/// green would pass for a measured one. A last odd column or row is left out.
pub fn superpixels(order: Bayer, columns: usize, values: &[u16], max: u16) -> Vec<u16> {
    let places = order.places();
    let mut out = Vec::with_capacity(values.len() / 4 * 3);
    let mut rows = values.chunks_exact(columns.max(1));
    while let (Some(upper), Some(lower)) = (rows.next(), rows.next()) {
        for (up, low) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
            let quad = [up[0], up[1], low[0], low[1]];
            let [red, first, second, blue] = places.map(|place| quad[place]);
            out.extend([red, mean(first, second, max), blue]);
        }
    }
    out
}

fn mean(a: u16, b: u16, max: u16) -> u16 {
    if a >= max || b >= max {
        return a.max(b);
    }
    let sum = u32::from(a) + u32::from(b);
    let half = sum / 2;
    (half + (sum & 1 & half)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_order_finds_its_colours() {
        let colours = |order, quad: [u16; 4]| superpixels(order, 2, &quad, 4095);
        assert_eq!(colours(Bayer::Rggb, [10, 20, 22, 30]), [10, 21, 30]);
        assert_eq!(colours(Bayer::Grbg, [20, 10, 30, 22]), [10, 21, 30]);
        assert_eq!(colours(Bayer::Gbrg, [20, 30, 10, 22]), [10, 21, 30]);
        assert_eq!(colours(Bayer::Bggr, [30, 20, 22, 10]), [10, 21, 30]);
    }

    #[test]
    fn means_do_not_drift_and_clipping_stays_visible() {
        // 20.5 and 21.5: one down, one up.
        assert_eq!((mean(20, 21, 4095), mean(21, 22, 4095)), (20, 22));
        assert_eq!(mean(4095, 4000, 4095), 4095);
        assert_eq!(mean(65535, 65535, 65535), 65535);
        // A 3 × 3 picture has one quad.
        assert_eq!(superpixels(Bayer::Rggb, 3, &[1, 2, 9, 2, 3, 9, 9, 9, 9], 255), [1, 2, 3]);
    }
}
