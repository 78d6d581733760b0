//! Text files of points.

use crate::Failure;
use std::path::Path;

/// Pairs of numbers, separated by white space or commas; `#` starts a comment.
pub(super) fn read_points(path: &Path) -> Result<Vec<[f64; 2]>, Failure> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::input(format!("{name}: cannot be read: {e}")))?;
    let mut numbers = Vec::new();
    for (line, content) in text.lines().enumerate() {
        let content = content.split('#').next().unwrap_or_default();
        let words = content.split(|c: char| c.is_whitespace() || c == ',');
        for word in words.filter(|w| !w.is_empty()) {
            let number = word.parse::<f64>().ok().filter(|v| v.is_finite());
            numbers.push(number.ok_or_else(|| {
                let error = format!("{name}:{}: expected numbers, found {word:?}", line + 1);
                Failure::input(error)
            })?);
        }
    }
    if numbers.len() % 2 != 0 {
        let error = format!("{name}: expected x y pairs, found {} numbers", numbers.len());
        return Err(Failure::input(error));
    }
    Ok(numbers.chunks_exact(2).map(|p| [p[0], p[1]]).collect())
}
