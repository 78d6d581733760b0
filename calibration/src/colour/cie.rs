//! CIE colorimetry: XYZ, L*a*b*, colour differences, and sRGB for pictures.

/// White of the CIE standard illuminants for the 2° observer, Y = 1 (CIE 15; D65 as in sRGB).
pub(crate) const D50: [f64; 3] = [0.9642, 1.0, 0.8251];
pub(crate) const D65: [f64; 3] = [0.9505, 1.0, 1.0890];
/// Light of equal energy at each wavelength.
pub(crate) const EQUAL_ENERGY: [f64; 3] = [1.0, 1.0, 1.0];

/// L*a*b* of XYZ under a white (CIE 15, section 8.2.1).
pub(crate) fn lab(xyz: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    const KNEE: f64 = 6.0 / 29.0;
    let f = |t: f64| {
        if t > KNEE.powi(3) { t.cbrt() } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 }
    };
    let [x, y, z] = std::array::from_fn(|i| f(xyz[i] / white[i]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// XYZ of L*a*b* under a white.
pub(crate) fn xyz_of_lab([l, a, b]: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    const KNEE: f64 = 6.0 / 29.0;
    let y = (l + 16.0) / 116.0;
    let t = [y + a / 500.0, y, y - b / 200.0];
    std::array::from_fn(|i| {
        let t = t[i];
        let linear = 3.0 * KNEE * KNEE * (t - 4.0 / 29.0);
        white[i] * if t > KNEE { t.powi(3) } else { linear }
    })
}

/// CIEDE2000 between two colours in L*a*b*, with all parametric factors 1.
///
/// Formulas and their branches at hue 0 follow Sharma, Wu & Dalal, "The CIEDE2000
/// color-difference formula: implementation notes" (2005), equations 2 to 22.
pub fn delta_e2000([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    let saturating = |c: f64| (c.powi(7) / (c.powi(7) + 25.0_f64.powi(7))).sqrt();
    let mean_chroma = (a1.hypot(b1) + a2.hypot(b2)) / 2.0;
    let stretch = 1.5 - 0.5 * saturating(mean_chroma);
    let (a1, a2) = (stretch * a1, stretch * a2);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    let hue = |a: f64, b: f64| b.atan2(a).to_degrees().rem_euclid(360.0);
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));
    let grey = c1 * c2 == 0.0;
    // Of the two ways around the circle the shorter one.
    let turn = match h2 - h1 {
        _ if grey => 0.0,
        d if d > 180.0 => d - 360.0,
        d if d < -180.0 => d + 360.0,
        d => d,
    };
    let mean_hue = match h1 + h2 {
        sum if grey => sum,
        sum if (h1 - h2).abs() <= 180.0 => sum / 2.0,
        sum if sum < 360.0 => (sum + 360.0) / 2.0,
        sum => (sum - 360.0) / 2.0,
    };
    let (lightness, chroma) = ((l1 + l2) / 2.0, (c1 + c2) / 2.0);
    let cos = |factor: f64, offset: f64| (factor * mean_hue + offset).to_radians().cos();
    let t = 1.0 - 0.17 * cos(1.0, -30.0) + 0.24 * cos(2.0, 0.0) + 0.32 * cos(3.0, 6.0)
        - 0.20 * cos(4.0, -63.0);
    let off = (lightness - 50.0).powi(2);
    let dl = (l2 - l1) / (1.0 + 0.015 * off / (20.0 + off).sqrt());
    let dc = (c2 - c1) / (1.0 + 0.045 * chroma);
    let dh = 2.0 * (c1 * c2).sqrt() * (turn / 2.0).to_radians().sin() / (1.0 + 0.015 * chroma * t);
    let rotation = 30.0 * (-((mean_hue - 275.0) / 25.0).powi(2)).exp();
    let cross = -(2.0 * rotation).to_radians().sin() * 2.0 * saturating(chroma);
    (dl * dl + dc * dc + dh * dh + cross * dc * dh).max(0.0).sqrt()
}

/// The product of a matrix, row by row, and a colour.
pub(crate) fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| m[i].iter().zip(v).map(|(a, b)| a * b).sum())
}

/// Linear sRGB to XYZ under D65 (IEC 61966-2-1).
pub(crate) const SRGB_TO_XYZ: [[f64; 3]; 3] =
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];

const XYZ_TO_SRGB: [[f64; 3]; 3] =
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];

/// XYZ under one white to the same colour under another, by Bradford's sharpened cones.
pub(crate) fn adapt(xyz: [f64; 3], from: [f64; 3], to: [f64; 3]) -> [f64; 3] {
    const CONES: [[f64; 3]; 3] =
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
    const BACK: [[f64; 3]; 3] = [
        [0.986_993, -0.147_054, 0.159_963],
        [0.432_305, 0.518_360, 0.049_291],
        [-0.008_529, 0.040_043, 0.968_487],
    ];
    let [seen, old, new] = [xyz, from, to].map(|v| times(&CONES, v));
    times(&BACK, std::array::from_fn(|i| seen[i] * new[i] / old[i]))
}

/// 8-bit sRGB of XYZ under a white; colours beyond its gamut are clipped.
pub(crate) fn srgb_codes(xyz: [f64; 3], white: [f64; 3]) -> [u8; 3] {
    times(&XYZ_TO_SRGB, adapt(xyz, white, D65)).map(|v| {
        let v = v.clamp(0.0, 1.0);
        let code = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * code).round() as u8
    })
}

/// Linear light of an sRGB code from 0 to 1 (IEC 61966-2-1).
pub fn srgb_to_linear(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The 34 pairs of Sharma, Wu & Dalal 2005, table 1: L a b, L a b, difference.
    const PAIRS: [[f64; 7]; 34] = [
        [50.0, 2.6772, -79.7751, 50.0, 0.0, -82.7485, 2.0425],
        [50.0, 3.1571, -77.2803, 50.0, 0.0, -82.7485, 2.8615],
        [50.0, 2.8361, -74.02, 50.0, 0.0, -82.7485, 3.4412],
        [50.0, -1.3802, -84.2814, 50.0, 0.0, -82.7485, 1.0],
        [50.0, -1.1848, -84.8006, 50.0, 0.0, -82.7485, 1.0],
        [50.0, -0.9009, -85.5211, 50.0, 0.0, -82.7485, 1.0],
        [50.0, 0.0, 0.0, 50.0, -1.0, 2.0, 2.3669],
        [50.0, -1.0, 2.0, 50.0, 0.0, 0.0, 2.3669],
        [50.0, 2.49, -0.001, 50.0, -2.49, 0.0009, 7.1792],
        [50.0, 2.49, -0.001, 50.0, -2.49, 0.001, 7.1792],
        [50.0, 2.49, -0.001, 50.0, -2.49, 0.0011, 7.2195],
        [50.0, 2.49, -0.001, 50.0, -2.49, 0.0012, 7.2195],
        [50.0, -0.001, 2.49, 50.0, 0.0009, -2.49, 4.8045],
        [50.0, -0.001, 2.49, 50.0, 0.001, -2.49, 4.8045],
        [50.0, -0.001, 2.49, 50.0, 0.0011, -2.49, 4.7461],
        [50.0, 2.5, 0.0, 50.0, 0.0, -2.5, 4.3065],
        [50.0, 2.5, 0.0, 73.0, 25.0, -18.0, 27.1492],
        [50.0, 2.5, 0.0, 61.0, -5.0, 29.0, 22.8977],
        [50.0, 2.5, 0.0, 56.0, -27.0, -3.0, 31.903],
        [50.0, 2.5, 0.0, 58.0, 24.0, 15.0, 19.4535],
        [50.0, 2.5, 0.0, 50.0, 3.1736, 0.5854, 1.0],
        [50.0, 2.5, 0.0, 50.0, 3.2972, 0.0, 1.0],
        [50.0, 2.5, 0.0, 50.0, 1.8634, 0.5757, 1.0],
        [50.0, 2.5, 0.0, 50.0, 3.2592, 0.335, 1.0],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.263],
        [61.2901, 3.7196, -5.3901, 61.4292, 2.248, -4.962, 1.8731],
        [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
        [22.7233, 20.0904, -46.694, 23.0331, 14.973, -42.5619, 2.0373],
        [36.4612, 47.858, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
        [90.8027, -2.0831, 1.441, 91.1528, -1.6435, 0.0447, 1.4441],
        [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.135, 0.9033, -0.0636, -0.5514, 0.9082],
    ];

    #[test]
    fn sharmas_pairs_come_out_as_published() {
        for pair in PAIRS {
            let [l1, a1, b1, l2, a2, b2, published] = pair;
            let found = delta_e2000([l1, a1, b1], [l2, a2, b2]);
            // Published to four decimals.
            assert!((found - published).abs() < 1e-4, "{pair:?}: {found}");
            let back = delta_e2000([l2, a2, b2], [l1, a1, b1]);
            assert!((found - back).abs() < 1e-12, "{pair:?}: not symmetric");
        }
    }

    #[test]
    fn colours_come_back() {
        for lab_in in [[50.0, 20.0, -30.0], [95.0, 0.0, 0.0], [3.0, 1.0, 2.0]] {
            let back = lab(xyz_of_lab(lab_in, D50), D50);
            assert!((0..3).all(|i| (back[i] - lab_in[i]).abs() < 1e-9), "{back:?}");
        }
        let white = adapt(D50, D50, D65);
        // The published matrices have six digits.
        assert!((0..3).all(|i| (white[i] - D65[i]).abs() < 1e-5), "{white:?}");
        assert_eq!(srgb_codes(D50, D50), [255, 255, 255]);
        let red = times(&SRGB_TO_XYZ, [1.0, 0.0, 0.0]);
        assert_eq!(srgb_codes(red, D65), [255, 0, 0]);
    }
}
