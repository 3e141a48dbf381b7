"""Words on signs, in the languages that buildings are labelled in: names of rooms without a number, and notices.

Compared without case, accents kept; a word is the whole of a line or one of its words.
"""

from __future__ import annotations

import re


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# What a plate names beside its number, or instead of one
SERVICE_WORDS = _words(
    """
    men women gents ladies gentlemen boys girls unisex wc toilet toilets restroom restrooms washroom bathroom lavatory
    shower showers stair stairs stairway staircase stairwell elevator elevators lift lifts janitor electrical mechanical
    herren damen toilette toiletten dusche duschen treppe treppenhaus aufzug lager putzraum küche teeküche
    hommes femmes messieurs dames toilettes sanitaires douche douches escalier escaliers ascenseur
    hombres mujeres caballeros señoras damas aseo aseos servicios baño baños ducha duchas escalera escaleras ascensor
    uomini donne bagno bagni servizi doccia docce scala scale ascensore
    homens mulheres masculino feminino sanitário sanitários banheiro escada escadas elevador
    heren dames trap trappen lift męski damska toaleta schody winda мужской женский туалет лестница лифт
    남자 여자 화장실 계단 男 女 男厕 女厕 洗手间 厕所 卫生间 楼梯 电梯 男子 女子 トイレ お手洗い 化粧室 階段
    """
)

# What no plate says: directions, hours, prices, alarms, safety, equipment
_NOTICE_WORDS = _words(
    """
    exit exits emergency fire danger caution warning alarm extinguisher hydrant voltage hose
    open opening opens closed close closes hours call tel phone telephone fax hotline mail www http https
    push pull press keep please no smoking do not stop beware attention notice sale price free
    rooms offices classes floors levels buildings to from through upstairs downstairs
    course exam concert fair event change moved starts begins every daily weekly
    bus train platform gate track
    model serial type volt volts watt inv inventory asset property copyright rights max min persons capacity
    ausgang notausgang feuer feuerlöscher gefahr achtung vorsicht notruf notfall geöffnet geschlossen öffnungszeiten
    räume zimmern büros bis von uhr preis rauchen verboten inventar hersteller typ
    sortie secours incendie feu danger défense ouvert fermé horaires salles bureaux prix interdit
    salida emergencia incendio incendios extintor peligro abierto cerrado horario precio salas prohibido
    uscita emergenza antincendio estintore pericolo aperto chiuso orario prezzo aule vietato
    saída emergência extintor perigo aberto fechado horário preço proibido
    uitgang nooduitgang brand brandblusser gevaar gesloten выход пожар 출구 비상구 소화기
    出口 安全出口 灭火器 非常口 消火器
    """
)
_ARROWS = re.compile("[←→↑↓↔↕⇐⇒⇑⇓➔➜➡⬅⬆⬇►◄▲▼<>]")
_SIGNS = re.compile(r"[%€$£¥°©®@=+*?!]")
_WORD = re.compile(r"[^\W\d_]+")
_NAME_WORDS_MAX, _NAME_LETTERS_MAX = 5, 32


def is_service(text: str) -> bool:
    """Whether a line names a room that needs no number, such as WOMEN or STAIR 2 without its digit."""
    words = _WORD.findall(text.casefold())
    return 0 < len(words) <= 2 and all(word in SERVICE_WORDS for word in words)


def is_notice(text: str) -> bool:
    """Whether a line says what no plate does: an arrow, a sign of a price or a share, a word of a notice."""
    if _ARROWS.search(text) or _SIGNS.search(text):
        return True
    return any(word in _NOTICE_WORDS for word in _WORD.findall(text.casefold()))


def is_name(text: str) -> bool:
    """Whether a line may be a person's, a group's or a room's name: few words, each with a capital, no digits."""
    words = _WORD.findall(text)
    letters = sum(len(word) for word in words)
    if not words or len(words) > _NAME_WORDS_MAX or letters > _NAME_LETTERS_MAX or any(c.isdigit() for c in text):
        return False
    return all(len(word) < 4 or not word[0].islower() for word in words)
