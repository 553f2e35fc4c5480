// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The look of a report on screens, phones and paper.
#pragma once

namespace soilvdb::tools {

inline constexpr const char* kReportStyle = R"(
:root { color-scheme: light; --ink: #1d2327; --faint: #5a646b; --line: #d5dadd; --soft: #f3f5f6; --link: #0b5a86; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1080px; padding: 24px; background: #fff; color: var(--ink);
  font: 14px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
header { border-bottom: 2px solid var(--ink); padding-bottom: 10px; }
h1 { font-size: 24px; line-height: 1.2; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 16px; margin: 28px 0 8px; break-after: avoid; overflow-wrap: anywhere; }
p { margin: 4px 0 0; }
.faint { color: var(--faint); }
nav { display: flex; flex-wrap: wrap; align-items: baseline; gap: 4px 22px; margin: 12px 0; }
nav span { display: inline-flex; flex-wrap: wrap; align-items: baseline; gap: 4px 10px; }
a { color: var(--link); }
[aria-current] { color: inherit; font-weight: 600; text-decoration: none; }
dl.sums { display: grid; grid-template-columns: repeat(auto-fit, minmax(128px, 1fr)); gap: 10px; margin: 18px 0 0; }
dl.sums div { border: 1px solid var(--line); border-radius: 6px; padding: 8px 12px; }
dl.sums dt { color: var(--faint); }
dl.sums dd { margin: 0; font-size: 19px; font-weight: 600; white-space: nowrap; }
dl.sums small { display: block; font-size: 13px; font-weight: 400; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 8px; text-align: right; border-bottom: 1px solid var(--line); vertical-align: baseline; white-space: nowrap; }
thead th { vertical-align: bottom; color: var(--faint); font-weight: 500; border-bottom: 1px solid var(--ink); }
th:first-child { text-align: left; padding-left: 0; }
tbody th { font-weight: 400; }
:is(.machines, .areas) tbody th { white-space: normal; overflow-wrap: anywhere; min-width: 76px; }
tfoot th, tfoot td { font-weight: 600; border-top: 1px solid var(--ink); border-bottom: 0; }
tr { break-inside: avoid; }
.charts { display: grid; grid-template-columns: 1fr 1fr; gap: 12px 28px; margin-top: 20px; }
figure { margin: 0; break-inside: avoid; }
figcaption, ul.key { overflow-wrap: anywhere; }
figcaption { font-weight: 600; }
svg.chart { display: block; width: 100%; height: auto; }
svg text { font: 11px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; fill: var(--faint); }
ul.key { display: flex; flex-wrap: wrap; gap: 2px 16px; margin: 2px 0 0; padding: 0; list-style: none; }
ul.key svg { width: 12px; height: 12px; margin-right: 6px; vertical-align: -1px; }
footer { break-inside: avoid; margin-top: 28px; padding-top: 8px; border-top: 1px solid var(--line); color: var(--faint); font-size: 12.5px; }
@media (max-width: 720px) {
  body { padding: 16px; }
  .charts { grid-template-columns: 1fr; }
  dl.sums { grid-template-columns: 1fr 1fr; }
  nav a { padding: 6px 0; }
  thead { display: none; }
  table, tbody, tfoot { display: block; }
  tr { display: grid; grid-template-columns: repeat(auto-fit, minmax(84px, 1fr)); gap: 4px 10px; padding: 8px 0; border-bottom: 1px solid var(--line); }
  tfoot tr { border-top: 1px solid var(--ink); border-bottom: 0; }
  th, td, tfoot th, tfoot td { border: 0; padding: 0; text-align: left; white-space: normal; overflow-wrap: anywhere; }
  tbody th { font-weight: 600; }
  tr > th { grid-column: 1 / -1; }
  td::before { content: attr(data-name); display: block; color: var(--faint); font-size: 12px; font-weight: 400; }
}
@page { size: A4; margin: 14mm 14mm 16mm; @bottom-right { content: counter(page) " / " counter(pages); font: 9pt system-ui, sans-serif; } }
@media print {
  body { max-width: none; padding: 0; font-size: 9.5pt; }
  nav { display: none; }
  h1 { font-size: 17pt; } h2 { font-size: 11.5pt; margin-top: 16pt; }
  dl.sums { grid-template-columns: repeat(6, 1fr); gap: 6pt; }
  dl.sums div { padding: 4pt 6pt; }
  dl.sums dd { font-size: 12pt; }
  dl.sums small { font-size: 8pt; }
  tfoot { display: table-row-group; }
  th, td { padding: 2.5pt 4pt; }
  a { color: inherit; text-decoration: none; }
}
)";

}  // namespace soilvdb::tools
