//! The page of a folder with a folder for each photograph: no script, and pictures from beside it.

use crate::program::many::Row;
use crate::program::report::page::{STYLE, escaped};
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

/// The page of `all` photographs, or of those that a run has so far, the least sure first; each has a folder with a `thumbnail`.
pub(crate) fn photographs_page(rows: &[Row], all: usize, thumbnail: &str, files: &[&str]) -> String {
    let mut sorted: Vec<&Row> = rows.iter().collect();
    // What failed comes before what has a sigma.
    let sigma = |row: &Row| if row.error.is_some() { f64::INFINITY } else { row.sigma.unwrap_or(0.0) };
    sorted.sort_by(|a, b| sigma(b).total_cmp(&sigma(a)).then(a.folder.cmp(&b.folder)));
    let mut body = String::new();
    let number = |value: Option<f64>, times: f64| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{:.2}", times * v))
    };
    for row in &sorted {
        let (name, folder) = (quoted(&row.photograph), quoted(&row.folder));
        let picture = match &row.error {
            Some(error) => format!("failed: {}", quoted(error)),
            None => format!(
                "<a href=\"{folder}/{}\"><img loading=\"lazy\" src=\"{folder}/{thumbnail}\" alt=\"{name}: photograph, depth, sigma / depth\"></a>",
                super::FILE
            ),
        };
        // A photograph that could not be read has no size.
        let about = match row.width {
            0 => String::new(),
            width => format!("{width}x{}, {}", row.height, quoted(&row.camera)),
        };
        let _ = writeln!(
            body,
            "<tr><td>{picture}</td><td>{name}<br>{about}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1}</td></tr>",
            number(row.sigma, 100.0),
            number(row.sigma_90, 100.0),
            number(row.median_depth, 1.0),
            row.seconds
        );
    }
    let count = match rows.len() {
        count if count < all => format!("{count} of {all} photographs, so far"),
        count => format!("{count} photographs"),
    };
    let failed = rows.iter().filter(|row| row.error.is_some()).count();
    let links: Vec<String> =
        files.iter().map(|file| format!("<a href=\"{0}\">{0}</a>", quoted(file))).collect();
    let unit = rows.iter().map(|row| row.unit.as_str()).find(|unit| !unit.is_empty()).unwrap_or("-");
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{count}</title>\n\
         <style>{STYLE}\ntd, th {{ padding: 0.3rem 0.8rem; text-align: left; }}\ntd:first-child {{ white-space: normal; min-width: 18rem; }}</style>\n</head>\n<body>\n<main>\n<h1>{count}</h1>\n\
         <p>{failed} failed. The least sure are first: by the median of sigma / depth. A picture (photograph, depth, sigma / depth) leads to its report. \
         All together: {links}.</p>\n<div style=\"overflow: auto\"><table>\n<tr><th></th><th>photograph</th><th>sigma / depth, %</th><th>90 % below, %</th>\
         <th>median depth, {unit}</th><th>seconds</th></tr>\n{body}</table></div>\n</main>\n</body>\n</html>\n",
        links = links.join(", "),
        unit = quoted(unit),
    )
}

fn quoted(text: &str) -> String {
    escaped(text).replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_sure_and_what_failed_come_first() {
        let row = |name: &str, sigma: Option<f64>, error: Option<&str>| Row {
            photograph: format!("<{name}>"),
            folder: name.to_owned(),
            sigma,
            error: error.map(str::to_owned),
            ..Row::default()
        };
        let rows = [row("a", Some(0.1), None), row("b", Some(0.3), None), row("c", None, Some("no & such"))];
        let html = photographs_page(&rows, 3, "small.png", &["index.csv"]);
        assert!(html.contains("<h1>3 photographs</h1>"), "{html}");
        let partial = photographs_page(&rows[..2], 3, "small.png", &["index.csv"]);
        assert!(partial.contains("<h1>2 of 3 photographs, so far</h1>"), "{partial}");
        let at = |name: &str| html.find(&format!("&lt;{name}&gt;<br>")).unwrap();
        assert!(at("c") < at("b") && at("b") < at("a"), "{html}");
        assert!(
            html.contains("failed: no &amp; such")
                && html.contains("src=\"a/small.png\"")
                && !html.contains("<a>")
        );
    }

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
