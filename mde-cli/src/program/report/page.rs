//! The page around the data.

use serde_json::Value;

const PAGE: &str = include_str!("assets/page.html");
pub(super) const STYLE: &str = include_str!("assets/report.css");
const COMMON: &str = include_str!("assets/common.js");
const ORBIT: &str = include_str!("assets/orbit.js");
const TRIANGLE: &str = include_str!("assets/triangle.js");
/// Everything that the scripts share, then the parts, then the start.
const SCRIPTS: [&str; 11] = [
    COMMON,
    ORBIT,
    TRIANGLE,
    include_str!("assets/layers.js"),
    include_str!("assets/photographs.js"),
    include_str!("assets/viewer.js"),
    include_str!("assets/cloud.js"),
    include_str!("assets/chart.js"),
    include_str!("assets/run.js"),
    include_str!("assets/evaluation.js"),
    include_str!("assets/start.js"),
];

/// The whole page. The data go in last, so that nothing in them is taken for a place to fill.
pub(super) fn page(title: &str, data: &Value) -> String {
    PAGE.replace("{{title}}", &escaped(title))
        .replace("{{style}}", STYLE)
        .replace("{{script}}", &SCRIPTS.concat())
        .replacen("{{data}}", &inert(data), 1)
}

/// The view of a capture within another page: its place, its data and its scripts.
pub(super) fn embedded(data: &Value) -> String {
    let script = [COMMON, ORBIT, TRIANGLE, include_str!("assets/capture.js")].concat();
    let data = inert(data);
    format!(
        "<div id=\"capture\"></div>\n<script type=\"application/json\" id=\"data\">{data}</script>\n\
         <script>\n\"use strict\";\n(() => {{\n{script}}})();\n</script>\n"
    )
}

/// JSON that can neither end its script element nor begin another.
fn inert(data: &Value) -> String {
    data.to_string().replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace("{{", "{ {")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn nothing_in_the_data_ends_the_script() {
        let hostile = "</script><script>alert(1)</script><!-- {{style}} \u{2028}";
        let html = page(hostile, &json!({ "kind": "run", "text": hostile }));
        assert_eq!(html.matches("</script>").count(), 2);
        assert!(html.contains("\\u003c/script>") && !html.contains("alert(1)</script>"));
        assert_eq!(html.matches(STYLE).count(), 1);
        let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
        let end = start + html[start..].find("</script>").unwrap();
        let data: Value = serde_json::from_str(&html[start..end]).unwrap();
        assert_eq!(data["text"], hostile);
    }
}
