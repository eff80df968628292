// @ts-check
/** The line to the server of the studio. */

/**
 * Ask the server. Raises an error with its words, and the key of the scene that they are about.
 * @param {string} name
 * @param {any} [body] posted where given
 * @returns {Promise<any>}
 */
export async function ask(name, body) {
  const answer = await fetch(`api/${name}`, body === undefined ? {} : {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body),
  });
  const text = await answer.text();
  let found;
  try {
    found = JSON.parse(text);
  } catch {
    throw new Error(answer.ok ? "the answer is not JSON" : text.trim());
  }
  if (!answer.ok) throw Object.assign(new Error(found.error ?? `the server answers ${answer.status}`), { key: found.key });
  return found;
}
