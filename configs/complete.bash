# Completion of `python -m experiments.NAME ...`: experiments, their presets, keys, and values to choose from.
#   bash:  source configs/complete.bash
#   zsh:   autoload -U compinit bashcompinit; compinit; bashcompinit; source configs/complete.bash
# What an experiment knows is asked of it at the first TAB, in a few seconds, and then known to this shell.

if [[ -n "${ZSH_VERSION:-}" ]]; then typeset -gA _urbanjax_known; else declare -gA _urbanjax_known; fi

_urbanjax_complete() {
    local line="${COMP_LINE:0:$COMP_POINT}" word before
    word="${line##*[[:space:]]}"
    before="${line%"$word"}"
    COMPREPLY=()
    if [[ "$before" =~ ^[^[:space:]]+[[:space:]]+-m[[:space:]]+$ ]]; then
        _urbanjax_fitting "$word" "$(printf '%s\n' experiments/*/__main__.py | sed 's|/__main__.py| |; s|/|.|')"
    elif [[ "$before" =~ ^[^[:space:]]+[[:space:]]+-m[[:space:]]+experiments\.[a-z_]+[[:space:]] ]]; then
        _urbanjax_ask $(printf '%s\n' "$before" | awk '{ print $1, $3 }')
        _urbanjax_fitting "$word" "$_urbanjax_lines"
    fi  # some other program: nothing is said, and the shell completes names of files
}

# What an experiment knows, a line each, in _urbanjax_lines.
_urbanjax_ask() {
    local program="${1/#\~/$HOME}" module="$2" key="$PWD $1 $2"
    if [[ -z "${_urbanjax_known[$key]:-}" ]]; then
        _urbanjax_known[$key]="$("$program" -m "$module" -sc query=all 2>/dev/null </dev/null)"
    fi
    _urbanjax_lines="${_urbanjax_known[$key]:-}"
}

# Into COMPREPLY those lines that begin with a word, up to their next dot or equals sign. Bash takes what stands before
# an equals sign for a word of its own, zsh does not.
_urbanjax_fitting() {
    local word="$1" choice rest cut="" last=""
    if [[ -n "${BASH_VERSION:-}" && "$word" == *=* && "${COMP_WORDBREAKS:-}" == *=* ]]; then cut="${word%"${word##*=}"}"; fi
    while IFS= read -r choice; do
        [[ -n "$choice" && "$choice" == "$word"* && "$choice" != "$word" ]] || continue
        rest="${choice#"$word"}"
        if [[ "$word" != *=* && "$choice" == *=* ]]; then
            rest="${rest%%[.=]*}"
            choice="${choice:0:$((${#word} + ${#rest} + 1))}"
        fi
        [[ "$choice" == "$last" ]] || COMPREPLY+=("${choice#"$cut"}")
        last="$choice"
    done <<<"$2"
}

complete -o nospace -o bashdefault -o default -F _urbanjax_complete python python3
