//! The frame of a web page, and the elements that its sections consist of.

use crate::drawing::{Drawing, STYLE};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// A page that loads no other resource and contains no scripts.
pub fn document(title: &str, subtitle: &str, sections: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                // An empty icon, so that the browser does not request one.
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(include_str!("style.css"))) }
            }
            body {
                main {
                    header {
                        h1 { (title) }
                        p { (subtitle) }
                    }
                    (sections)
                }
            }
        }
    }
}

/// A section with its heading.
pub fn section(id: &str, title: &str, content: Markup) -> Markup {
    html! { section id=(id) aria-labelledby={ (id) "-title" } { h2 id={ (id) "-title" } { (title) } (content) } }
}

/// A table that can be scrolled if it is wider than the screen.
pub fn wide(label: &str, table: Markup) -> Markup {
    html! { div.wide tabindex="0" role="region" aria-label=(label) { (table) } }
}

/// Size of a legend, rem per unit of its drawing.
const LEGEND_SCALE: f64 = 0.075;

/// A legend in the page.
pub fn legend(entries: &[Drawing]) -> Markup {
    html! {
        div.key {
            @for entry in entries {
                span style=(format!("width:{:.1}rem", LEGEND_SCALE * entry.width)) { (entry.svg()) }
            }
        }
    }
}
