//! Texts with places that are filled in.

/// Pixels along the longer side of a scene's picture.
const PIXELS: f64 = 256.0;

/// Width and height in pixels of a picture of a face of those edges.
pub(crate) fn picture_size(width: f64, height: f64) -> [String; 2] {
    let longer = width.max(height);
    [width, height].map(|side| (PIXELS * side / longer).round().max(1.0).to_string())
}

/// `template` with each `{NAME}` replaced by the value of that name.
pub(crate) fn filled(template: &str, values: &[(&str, String)]) -> String {
    values.iter().fold(template.to_owned(), |text, (name, value)| {
        text.replace(&format!("{{{name}}}"), value)
    })
}

/// As text inside of an XML comment, where two hyphens would end it.
pub(crate) fn in_comment(text: &str) -> String {
    text.replace("--", "- -")
}
