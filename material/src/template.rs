//! Texts with places that are filled in.

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
