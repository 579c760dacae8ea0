/* Cleans the queries of the site's search: the index sees words of content, in the form that pages may have.

   Material appends "*" to each word of a query, so "a" finds every word that begins with "a", and "robots" does not find
   "robot". Here stop words are dropped and endings removed; "*" then finds all forms of a word. */

const STOP_WORDS = new Set(
  `a about after again all already also always am an and another any anything are as at be because been before being best but by can
  can't cannot could did do does doesn't doing don't done during each either else ever every for from get gets getting give go goes
  going had has have having here how i if in instead into is it it's its just keep let like made make makes making many may me might
  more most much must my need needs never no not now of off on once one only onto or other our out over please possible same shall
  should show so some someone something still such than that the their them then there these they this those through to too under
  until up us use used uses using very want wants was way we were what what's when where whether which while who whose why will with
  within would yet you your`.split(/\s+/));

/* Every page is about these, so they are dropped beside two other words. */
const COMMON_WORDS = new Set(["python", "ros", "ros2"]);

/* Return the start of a word that all its forms share: "merg" of "merging". */
function startOfForms(word) {
  if (!/^[a-z]{4,}$/i.test(word)) return word;  // names, such as tf2_ros or ROS_DOMAIN_ID, have no forms
  const singular = word.replace(/ies$/i, "y").replace(/(ss|x|ch|sh)es$/i, "$1").replace(/([^sui])s$/i, "$1");
  const start = singular.replace(/(ing|ed|e|y)$/i, "");
  if (/([bdgmnprt])\1$/i.test(start) && start !== singular) return start.slice(0, -1);  // "stopping"
  return start.length < 4 ? singular : start;
}

/* Return what the index is asked for. Queries that have operators are left alone. */
function cleanQuery(query) {
  if (/["+~^*]|(^|\s)-/.test(query)) return query;
  const words = query.split(/[\s\-?!,;()]+/).map(word => word.replace(/^['`.:]+|('s)?['`.:]*$/g, "")).filter(Boolean);
  const content = words.filter(word => word.length > 1 && !STOP_WORDS.has(word.toLowerCase()));
  const special = content.filter(word => !COMMON_WORDS.has(word.toLowerCase()));
  const best = special.length > 1 ? special : content.length ? content : words;
  return best.map(startOfForms).join(" ");
}

/* Message 2 to the worker of the search is a query. */
const postMessage = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (message, ...rest) {
  const isQuery = message?.type === 2 && typeof message.data === "string";
  postMessage.call(this, isQuery ? {...message, data: cleanQuery(message.data)} : message, ...rest);
};
