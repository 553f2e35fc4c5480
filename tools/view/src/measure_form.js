// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The form that edits a measure: its name and its points, which are dragged in the picture, too.
import {h} from './dom.js';
import * as format from './format.js';
import {kAgainOffline_ms, said} from './measures.js';
import * as units from './units.js';

const kAxes = ['E', 'N'];

/**
 * @param {import('./measures.js').Measures} measures @param {Object} measure that is being edited
 * @return {HTMLFormElement} its showPoints() takes over the measure's points
 */
export function editForm(measures, measure) {
  const name = h('input', {class: 'field', type: 'text', maxlength: 80, required: true, value: measure.name, autocomplete: 'off', 'aria-label': 'Name', placeholder: 'Name'});
  const points = h('div', {class: 'points'}), error = h('p', {class: 'error', role: 'alert', hidden: true});
  const summary = h('summary', {});
  const save = h('button', {class: 'button main', type: 'submit'}, 'Save');
  const removal = h('button', {class: 'button', type: 'button'}, 'Delete');
  const form = h('form', {class: 'edit'}, name,
    h('details', {}, summary, points), error,
    h('div', {class: 'buttons'}, save, h('button', {class: 'button', type: 'button', onclick: () => measures.cancelEdit()}, 'Cancel'), h('span', {class: 'grow'}),
      measure.kept === null ? null : removal));
  const attempt = async (act) => {
    save.disabled = true;
    try {
      await act();
      error.hidden = true;
    } catch (reason) {
      error.textContent = said(reason);
      error.hidden = false;
      if (reason.offline) return void setTimeout(() => { if (form.isConnected) attempt(act); }, kAgainOffline_ms);
    }
    save.disabled = false;
  };
  form.addEventListener('submit', (event) => {
    event.preventDefault();
    attempt(() => measures.endEdit(name.value.trim()));
  });
  form.addEventListener('keydown', (event) => {
    if (event.key === 'Escape') measures.cancelEdit();
  });
  removal.addEventListener('click', () => {
    if (!removal.dataset.asked) {   // others lose it, too
      removal.dataset.asked = 'yes';
      removal.textContent = 'Delete for all';
      return;
    }
    attempt(() => measures.discard(measure));
  });

  const place = (i, axis, field) => {
    const value = format.typedLength(field.value), valid = Number.isFinite(value);
    field.setCustomValidity(valid ? '' : `A coordinate is a number, in ${units.symbol('length')}`);
    if (!valid) return;
    measures.move(measure, measure.points.map((p, k) => (k === i ? [axis === 0 ? value : p[0], axis === 1 ? value : p[1]] : p)));
  };
  let shown = null, unit = null;
  form.showPoints = () => {
    if (shown === measure.points && unit === units.unit('length')) return;
    shown = measure.points;
    unit = units.unit('length');
    summary.textContent = `Points: drag them, or type coordinates, ${units.symbol('length')}`;
    if (points.childElementCount !== shown.length + 1) {
      points.replaceChildren(h('div', {class: 'axes', 'aria-hidden': 'true'}, h('span', {}), ...kAxes.map((axis) => h('span', {}, axis))), ...shown.map((p, i) => h('label', {}, h('span', {}, String(i + 1)), ...kAxes.map((axis, k) =>
        h('input', {class: 'field', inputmode: 'decimal', 'aria-label': `${axis} of point ${i + 1}`, onchange: (event) => place(i, k, event.target)})))));
    }
    shown.forEach((p, i) => {
      points.children[i + 1].querySelectorAll('input').forEach((field, k) => { field.value = format.toType(p[k]); });
    });
  };
  return form;
}
