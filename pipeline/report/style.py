"""The style sheet of a report: for any screen and for paper; no state by colour alone."""

from typing import Final

CSS: Final = """
:root { --ink: #1b2126; --soft: #56616b; --line: #d9dee3; --tint: #f4f6f8; --link: #00558c;
  --yes: #00664a; --yes-tint: #e3f3ed; --no: #9c3a00; --no-tint: #fbe9df;
  --open: #5c4a00; --open-tint: #fbf1cf; }
* { box-sizing: border-box; }
html { color: var(--ink); background: #fff; scroll-behavior: smooth;
  font: 16px/1.55 system-ui, "Segoe UI", "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
body { max-width: 70rem; margin: 0 auto; padding: 1.5rem clamp(1rem, 4vw, 2.5rem) 4rem;
  overflow-wrap: break-word; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 { font-size: 1.3rem; margin: 3rem 0 .75rem; padding-top: .75rem;
  border-top: 2px solid var(--ink); }
h3 { font-size: 1.05rem; margin: 1.75rem 0 .5rem; }
p, ul { margin: .5rem 0; max-width: 46rem; }
a { color: var(--link); }
nav { margin: 1rem 0 0; } nav a { margin-right: 1.1rem; white-space: nowrap; }
.soft { color: var(--soft); } .small { font-size: .875rem; }
.headline { font-size: 1.15rem; line-height: 1.45; max-width: 52rem; padding-left: 1rem;
  border-left: 4px solid var(--ink); }
.headline p { max-width: none; margin: .3rem 0; }
.banner { padding: .75rem 1rem; margin: 1rem 0; background: var(--no-tint);
  border-left: 4px solid var(--no); } .banner > * { max-width: none; }
.good, .yes { color: var(--yes); } .bad, .no { color: var(--no); }
.look, .open { color: var(--open); }
.mark { font-weight: 700; white-space: nowrap; }
table { width: 100%; border-collapse: collapse; font-size: .875rem; margin: 1rem 0;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding-bottom: .5rem; }
th, td { text-align: left; vertical-align: top; padding: .4rem .5rem;
  border-bottom: 1px solid var(--line); }
thead th { vertical-align: bottom; border-bottom: 2px solid var(--soft); font-weight: 600; }
tbody th { font-weight: 600; }
.table3 th, .numbers tbody th { white-space: nowrap; } .table3 thead th { white-space: normal; }
.numbers td { text-align: right; white-space: nowrap; }
.numbers thead th:not(:first-child) { text-align: right; }
.numbers td:nth-child(2), .numbers thead th:nth-child(2) { text-align: left; }
.table3 tr:nth-child(3n) > * { border-bottom-color: var(--soft); }
.table3 { font-size: .8125rem; }
.verdicts td { width: 29%; } .verdicts td > div { padding: .5rem .6rem; border-radius: .4rem; }
.verdicts td > .yes { background: var(--yes-tint); }
.verdicts td > .no { background: var(--no-tint); }
.verdicts td > .open { background: var(--open-tint); }
.verdicts td > .none { background: var(--tint); }
.verdicts td p { margin: .1rem 0; color: var(--ink); }
.verdicts svg { display: block; width: 100%; max-width: 15rem; height: 1.1rem; margin-top: .3rem; }
figure { margin: 1.5rem 0; } figure img { width: 100%; height: auto; display: block; }
figcaption { color: var(--soft); font-size: .875rem; max-width: 52rem; margin-top: .4rem; }
details { margin: .6rem 0; } summary { cursor: pointer; color: var(--link); }
summary:focus-visible, a:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
pre { background: var(--tint); padding: 1rem; font-size: .8125rem; white-space: pre-wrap;
  font-family: ui-monospace, Consolas, "DejaVu Sans Mono", monospace; }
td code { overflow-wrap: anywhere; }
code { font-family: ui-monospace, Consolas, "DejaVu Sans Mono", monospace; font-size: .8125rem; }
.trials { font-size: .8125rem; line-height: 1.35; } .trials td span { display: block; }
.trials td .small { color: var(--soft); font-size: .75rem; }
.trials th:first-child { white-space: nowrap; }
@media screen and (max-width: 64rem) {
  table, tbody, tr, td, th, caption { display: block; width: auto; }
  thead { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
  tr { padding: .5rem 0; border-bottom: 1px solid var(--soft); }
  th, td, .numbers td { border: 0; padding: .2rem 0; text-align: left; }
  .verdicts td { width: auto; }
  td::before { content: attr(data-label) " "; color: var(--soft); }
  .numbers td, .trials td { display: inline-block; margin-right: 1.25rem; }
}
@media print {
  html { font-size: 10.5px; } body { max-width: none; padding: 0; }
  nav { display: none; } h2 { break-after: avoid; }
  tr, figure, .verdicts td > div { break-inside: avoid; }
  details::details-content { content-visibility: visible; height: auto; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
