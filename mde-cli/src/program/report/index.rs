//! The page of a folder with a folder for each photograph, with pictures from beside it; without a script but for the view of a capture.

use crate::output::every::PhotographRow;
use crate::program::number;
use crate::program::report::page::{STYLE, escaped};
use std::fmt::Write as _;

/// The page of those of `all` photographs that a run has so far, the least sure first, each in a folder with `picture`, beside `files`;
/// `view` stands above the table.
pub(crate) fn photographs_page(
    rows: &[&PhotographRow],
    all: usize,
    picture: &str,
    files: &[&str],
    view: Option<&str>,
) -> String {
    let mut sorted = rows.to_vec();
    // What failed comes before what has a sigma.
    let sigma =
        |row: &PhotographRow| if row.error.is_some() { f64::INFINITY } else { row.sigma.unwrap_or(0.0) };
    sorted.sort_by(|a, b| sigma(b).total_cmp(&sigma(a)).then(a.photograph.cmp(&b.photograph)));
    let mut body = String::new();
    let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 2);
    for row in &sorted {
        let name = quoted(&row.photograph);
        let shown = row.folder.as_deref().map_or_else(String::new, |folder| {
            let folder = quoted(folder);
            format!(
                "<a href=\"{folder}/{}\"><img loading=\"lazy\" src=\"{folder}/{picture}\" alt=\"{name}: photograph, depth, sigma\" style=\"max-width: min(42rem, 88vw)\"></a>",
                super::FILE
            )
        });
        // A photograph that could not be read has no size.
        let size = format!("{}x{}, {}", row.width, row.height, quoted(&row.camera));
        let verified = row.verified.map(|share| format!("verified {:.1} %", 100.0 * share));
        let size = (row.width > 0).then_some(size);
        let words = [size, verified, row.failed_or_alone().map(|text| quoted(&text))];
        let about = words.into_iter().flatten().collect::<Vec<_>>().join("<br>");
        let _ = writeln!(
            body,
            "<tr><td>{shown}</td><td>{name}<br>{about}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1}</td></tr>",
            percent(row.sigma),
            percent(row.sigma_90),
            number(row.median_depth, 2),
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
         <style>{STYLE}\ntd, th {{ padding: 0.3rem 0.8rem; text-align: left; }}\nth {{ white-space: normal; }}\ntd:first-child {{ white-space: normal; min-width: min(18rem, 36vw); }}\n@media (max-width: 560px) {{ td:first-child img {{ width: 100%; height: auto; }} tr {{ display: grid; grid-template-columns: repeat(4, 1fr); }} td:nth-child(-n+2) {{ grid-column: 1 / -1; border: 0; }} th:nth-child(-n+2) {{ display: none; }} }}</style>\n</head>\n<body>\n<main>\n<h1>{count}</h1>\n\
         <p>{failed} failed. The least sure are first: by the median of sigma / depth. A picture leads to its report. \
         All together: {links}.</p>\n{view}<div style=\"overflow: auto\"><table>\n<tr><th></th><th>photograph</th><th>sigma / depth, %</th><th>90 % below, %</th>\
         <th>median depth, {unit}</th><th>seconds</th></tr>\n{body}</table></div>\n</main>\n</body>\n</html>\n",
        links = links.join(", "),
        view = view.unwrap_or_default(),
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
        let row = |name: &str, sigma: Option<f64>, error: Option<&str>| PhotographRow {
            folder: error.is_none().then(|| name.to_owned()),
            sigma,
            error: error.map(str::to_owned),
            ..PhotographRow::new(&format!("<{name}>\""))
        };
        let rows = [row("a", Some(0.1), None), row("b", Some(0.3), None), row("c", None, Some("no & such"))];
        let rows = rows.each_ref();
        let html = photographs_page(&rows, 3, "small.png", &["index.csv"], None);
        assert!(html.contains("<h1>3 photographs</h1>"), "{html}");
        let partial = photographs_page(&rows[..2], 3, "small.png", &["index.csv"], None);
        assert!(partial.contains("<h1>2 of 3 photographs, so far</h1>"), "{partial}");
        let at = |name: &str| html.find(&format!("<td>&lt;{name}&gt;&quot;<br>")).unwrap();
        assert!(at("c") < at("b") && at("b") < at("a"), "{html}");
        assert!(html.contains("failed: no &amp; such") && html.contains("src=\"a/small.png\""), "{html}");
        assert!(html.contains("href=\"b/report.html\"") && html.contains("href=\"index.csv\""), "{html}");
        assert_eq!((html.matches("<img").count(), html.matches("<a>").count()), (2, 0));
    }
}
