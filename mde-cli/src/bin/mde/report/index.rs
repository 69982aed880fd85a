//! The page of a folder with a folder for each photograph: no script, and pictures from beside it.

use super::page::{STYLE, escaped};
use std::fmt::Write as _;

/// A photograph of the page.
pub(crate) struct Indexed<'r> {
    pub(crate) photograph: &'r str,
    /// Its folder, with `report.html` and `preview.png`; none where it failed.
    pub(crate) folder: Option<&'r str>,
    /// What the summary says of it.
    pub(crate) text: String,
}

/// The whole page; `files` stand beside the folders.
pub(crate) fn index(title: &str, photographs: &[Indexed<'_>], files: &[&str]) -> String {
    let mut body = String::new();
    for Indexed { photograph, folder, text } in photographs {
        let (name, text) = (quoted(photograph), quoted(text));
        let _ = writeln!(body, "<h2>{name}</h2>\n<p>{text}</p>");
        if let Some(folder) = folder.map(quoted) {
            let picture = format!(
                "<img src=\"{folder}/preview.png\" alt=\"{name}: photograph, prior, refined depth, sigma\" style=\"max-width: 100%\">"
            );
            let _ = writeln!(body, "<p><a href=\"{folder}/{}\">{picture}</a></p>", super::FILE);
        }
    }
    let links: Vec<String> =
        files.iter().map(|file| format!("<a href=\"{0}\">{0}</a>", quoted(file))).collect();
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n\
         <p>A picture leads to the report of its photograph. All together: {}.</p>\n{body}</main>\n</body>\n</html>\n",
        links.join(", "),
        title = quoted(title),
    )
}

fn quoted(text: &str) -> String {
    escaped(text).replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_and_a_failure_has_no_link() {
        let good = Indexed { photograph: "<b>\".jpg", folder: Some("b"), text: "verified 80 %".to_owned() };
        let failed = Indexed { photograph: "c.jpg", folder: None, text: "failed: & \"x\"".to_owned() };
        let html = index("all", &[good, failed], &["cloud.ply"]);
        assert!(html.contains("&lt;b&gt;&quot;.jpg") && !html.contains("<b>"));
        assert!(html.contains("href=\"b/report.html\"") && html.contains("src=\"b/preview.png\""));
        assert_eq!((html.matches("<img").count(), html.matches("<a ").count()), (1, 2));
        assert!(html.contains("failed: &amp; &quot;x&quot;") && html.contains("href=\"cloud.ply\""));
    }
}
