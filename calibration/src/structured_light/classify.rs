//! Whether a pixel was lit: direct light against light that came by way of other points.

use crate::photo::Photo;

/// Grey code of a pixel of 1 or 3 channels: Rec. 601 luma, in 1/256.
pub(crate) fn grey(pixel: &[u16]) -> i32 {
    match *pixel {
        [v] => i32::from(v),
        [r, g, b] => (77 * i32::from(r) + 150 * i32::from(g) + 29 * i32::from(b)) >> 8,
        _ => 0,
    }
}

/// Grey codes of one row of a picture.
pub(crate) fn grey_row(photo: &Photo, y: usize, out: &mut [i32]) {
    let row = photo.data.chunks_exact(photo.width * photo.channels).nth(y).unwrap_or_default();
    if photo.channels == 1 {
        out.iter_mut().zip(row).for_each(|(o, &v)| *o = i32::from(v));
    } else {
        out.iter_mut().zip(row.chunks_exact(photo.channels)).for_each(|(o, px)| *o = grey(px));
    }
}

/// What a pixel gets straight from the projector and what by way of other points, codes above
/// black.
///
/// Under fine stripes, half of them lit, a pixel's brightest is D + G/2 and its darkest G/2
/// (Nayar, Krishnan, Grossberg & Raskar 2006, section 3); black is subtracted beforehand, so that
/// neither the projector's pedestal nor the room is taken for G.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Separation {
    pub(crate) direct: i32,
    pub(crate) global: i32,
}

impl Separation {
    pub(crate) fn new(brightest: i32, darkest: i32, black: i32) -> Self {
        Self { direct: brightest - darkest, global: 2 * (darkest - black).max(0) }
    }

    /// Whether the brighter of a picture and its inverse, which differ by `difference`, may not be
    /// the one that the pixel is lit in.
    ///
    /// With D > G it is (Xu & Aliaga 2007, section 4.1). Their second rule, codes outside of both
    /// ranges, needs D and G to be better known than fine stripes tell them: it is left out.
    /// `noise` is the least difference that means anything.
    pub(crate) fn in_doubt(self, difference: i32, noise: i32) -> bool {
        // No short cuts: so the loop over a row has no branches.
        (difference.abs() < noise) | (self.direct < noise) | (self.direct <= self.global)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn direct_light_is_told_from_the_rest() {
        // D 100, G 20, black 7.
        let plain = Separation::new(117, 17, 7);
        assert_eq!(plain, Separation { direct: 100, global: 20 });
        assert!(!plain.in_doubt(98, 10) && !plain.in_doubt(-98, 10));
        assert!(plain.in_doubt(4, 10));
        // D 20, G 100: the patterns' share of G outweighs D.
        let deep = Separation::new(70, 50, 0);
        assert_eq!(deep, Separation { direct: 20, global: 100 });
        assert!(deep.in_doubt(98, 10));
        // In the projector's shadow there is nothing to decide.
        assert!(Separation::new(6, 2, 1).in_doubt(60, 10));
    }
}
