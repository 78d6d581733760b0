//! Text into HTML.

/// Text that can stand anywhere in a page, attributes included.
pub(crate) fn escape(text: impl ToString) -> String {
    let mut out = String::new();
    for c in text.to_string().chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

/// A table of two columns; the second may hold HTML.
pub(crate) fn facts(rows: &[(&str, String)]) -> String {
    let rows: String =
        rows.iter().map(|(k, v)| format!("<tr><th>{}</th><td>{v}</td></tr>", escape(k))).collect();
    format!("<table class=\"facts\">{rows}</table>")
}

/// The text with its first letter capital.
pub(crate) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |c| c.to_uppercase().chain(chars).collect())
}

/// A section with a heading.
pub(crate) fn section(title: &str, body: &str) -> String {
    format!("<section><h2>{}</h2>{body}</section>\n", escape(title))
}

/// A whole page that needs nothing else; `style` comes after the style that all pages share.
pub(crate) fn page(title: &str, style: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <link rel=\"icon\" href=\"data:,\"><title>{} – Diaphane</title>\n<style>\n{}{style}</style></head>\n\
         <body><main>\n{body}</main>\n<script>\n{}</script></body></html>\n",
        escape(title),
        include_str!("style.css"),
        include_str!("script.js"),
    )
}

/// A date and time, UTC, from seconds since 1970.
pub(crate) fn utc(unix_s: u64) -> String {
    let (mut days, rest) = (unix_s / 86_400, unix_s % 86_400);
    let leap = |y: u64| (y.is_multiple_of(4) && !y.is_multiple_of(100)) || y.is_multiple_of(400);
    let mut year = 1970;
    // A file can hold any number: a year with more than four digits is no date of ours.
    while year < 9999 && days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 1;
    for length in lengths {
        if days < length || month == 12 {
            break;
        }
        days -= length;
        month += 1;
    }
    format!("{year}-{month:02}-{:02} {:02}:{:02} UTC", days + 1, rest / 3600, rest / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_gets_out_of_its_text() {
        let told = escape("<img src='x' onerror=\"a&b\">");
        assert_eq!(told, "&lt;img src=&#39;x&#39; onerror=&quot;a&amp;b&quot;&gt;");
    }

    /// Against `date -u -d @N`.
    #[test]
    fn dates_are_right() {
        assert_eq!(utc(0), "1970-01-01 00:00 UTC");
        assert_eq!(utc(951_782_399), "2000-02-28 23:59 UTC");
        assert_eq!(utc(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(utc(1_735_689_599), "2024-12-31 23:59 UTC");
        assert_eq!(utc(1_735_689_600), "2025-01-01 00:00 UTC");
    }
}
