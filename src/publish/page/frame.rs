//! What all pages have in common: head, style, the words for a verdict.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::publish::report::{StageRecord, Status};
use crate::publish::table::duration;

const STYLE: &str = include_str!("assets/style.css");

/// A whole page.
pub fn page(title: &str, body: Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="generator" content={ "chladni " (env!("CARGO_PKG_VERSION")) };
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { (body) } }
        }
    };
    page.into_string()
}

/// How a mesh ended, as a badge.
pub fn badge(status: Status) -> Markup {
    let (class, word) = match status {
        Status::Verified => ("good", "verified"),
        Status::Unverified => ("warn", "unverified"),
        Status::Failed => ("bad", "failed"),
    };
    html! { span class={ "badge " (class) } { (word) } }
}

/// The stages with their times, those of one kind after one another as one.
pub fn flow(stages: &[StageRecord]) -> Markup {
    let kind = |stage: &StageRecord| stage.stage.split(' ').next().unwrap_or_default().to_owned();
    let groups = stages.chunk_by(|a, b| kind(a) == kind(b) && a.stage.contains('φ'));
    html! {
        ol.flow {
            @for group in groups {
                @let seconds: f64 = group.iter().map(|stage| stage.seconds).sum();
                @let cached = group.iter().filter(|stage| stage.cached).count();
                li.cached[cached == group.len()] {
                    (group[0].stage)
                    @if group.len() > 1 { " … " (ending(&group[group.len() - 1].stage)) }
                    small {
                        (duration(seconds))
                        @if cached == group.len() { ", from the cache" }
                        @else if cached > 0 { ", " (cached) " from the cache" }
                    }
                }
            }
        }
    }
}

fn ending(stage: &str) -> &str {
    stage.rsplit_once(' ').map_or(stage, |(_, last)| last)
}
