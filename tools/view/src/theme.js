// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Dark or light: the system's setting, until the user chooses.
const kKey = 'soilvdb-theme';
const system = matchMedia('(prefers-color-scheme: light)');

function kept() {
  try {
    return localStorage.getItem(kKey);
  } catch {   // some browser settings forbid storage
    return null;
  }
}

/** @param {HTMLButtonElement} button @param {function(string)} changed with 'dark' or 'light' */
export function startTheme(button, changed) {
  const show = () => {
    const theme = kept() ?? (system.matches ? 'light' : 'dark');
    document.documentElement.dataset.theme = theme;
    button.setAttribute('aria-label', theme === 'dark' ? 'Light colours' : 'Dark colours');
    button.title = button.getAttribute('aria-label');
    changed(theme);
  };
  button.addEventListener('click', () => {
    const next = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
    try {
      localStorage.setItem(kKey, next);
    } catch {
      document.documentElement.dataset.theme = next;
    }
    show();
  });
  system.addEventListener('change', show);
  show();
}
